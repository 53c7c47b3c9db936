"""Ribbons are drawn where their nodes are, and what is invalid looks so."""

import numpy as np
import pytest
from ribbonhost.view.tubes import SIDES, STEPS, THICKNESS_M, WIDTH_M, Tubes
from view.combs import LAYOUT, moment


def test_rings_surround_the_curve_from_the_anchor_through_all_nodes() -> None:
    shown = moment(radius_m=0.3)
    tubes = Tubes(LAYOUT)
    rings = tubes.rings(shown, shown.q_world_node).reshape(5, STEPS * 16 + 1, SIDES, 3)
    centre = rings.mean(axis=2)
    assert centre[:, 0] == pytest.approx(shown.anchor_m, abs=1e-6)
    assert centre[:, STEPS::STEPS] == pytest.approx(shown.node_m.reshape(5, 16, 3), abs=1e-6)
    off = np.linalg.norm(rings - centre[:, :, None], axis=-1)
    assert off.max() == pytest.approx(WIDTH_M / 2, rel=0.01)
    assert off.min() == pytest.approx(THICKNESS_M / 2, rel=0.01)


def test_round_tubes_have_the_radius_of_their_nodes() -> None:
    shown = moment()
    radius_m = np.linspace(0.001, 0.02, 80)
    rings = Tubes(LAYOUT).rings(shown, shown.q_world_node, radius_m).reshape(5, STEPS * 16 + 1, SIDES, 3)
    off = np.linalg.norm(rings - rings.mean(axis=2, keepdims=True), axis=-1)
    assert off[:, STEPS::STEPS].mean(axis=2).ravel() == pytest.approx(radius_m, rel=1e-3)


def test_each_part_of_a_tube_belongs_to_one_node() -> None:
    tubes = Tubes(LAYOUT)
    nodes = np.zeros(80, np.bool_)
    nodes[20] = True
    of_one, of_others = tubes.faces(nodes), tubes.faces(~nodes)
    assert len(of_one) == 2 * SIDES * STEPS
    assert len(of_one) + len(of_others) == 5 * 16 * STEPS * 2 * SIDES


def test_invalid_nodes_are_directed_as_their_neighbours() -> None:
    shown = moment(radius_m=0.4)
    true = shown.q_world_node.copy()
    shown.known[[20, 37]] = False
    shown.q_world_node[[20, 37]] = np.nan
    q = shown.bridged(LAYOUT)
    same = np.abs(np.einsum("ni,ni->n", q, true))
    assert same == pytest.approx(1.0, abs=1e-5)
    assert shown.there(LAYOUT).all()
