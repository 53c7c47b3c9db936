"""What colours mean: curvature, uncertainty and error are what they are said to be, and scales are round."""

from dataclasses import replace

import numpy as np
import pytest
from ribbonhost.reconstruct import comb_uncertainty, tube_radius_m
from ribbonhost.view.shading import BANDS, CURVATURE, HEIGHT, Scale, node_curvature_per_m, node_error_m
from ribbonhost.view.shading import node_radius_m as radius_m
from view.combs import COMB, LAYOUT, moment


def test_the_curvature_of_a_cylinder_is_one_over_its_radius() -> None:
    found = node_curvature_per_m(LAYOUT, moment(radius_m=0.4)).reshape(5, 16)
    assert np.isnan(found[0]).all(), "a reference bears no surface of its own"
    assert found[1:, 1:-1] == pytest.approx(2.5, rel=0.01)


def test_the_radius_at_nodes_is_that_of_the_uncertainty_of_the_comb() -> None:
    shown = moment(quality=7)
    assert shown.comb is not None
    sigma_rad = shown.sigma_rad.reshape(5, 16)
    whole = comb_uncertainty(COMB, shown.comb, shown.q_world_node.reshape(5, 16, 4), sigma_rad)
    assert radius_m(LAYOUT, shown) == pytest.approx(tube_radius_m(whole.node_m2).ravel(), rel=1e-9)


def test_an_unknown_sigma_is_an_unknown_radius_of_its_ribbon_only() -> None:
    shown = moment()
    shown.sigma_rad[LAYOUT.slices[2]] = np.nan
    known = np.isfinite(radius_m(LAYOUT, shown)).reshape(5, 16)
    assert known.all(axis=1).tolist() == [True, True, False, True, True]


def test_the_error_is_the_distance_from_the_truth() -> None:
    shown = moment()
    assert np.isnan(node_error_m(shown)).all()
    aside = replace(shown, truth_m=shown.node_m + np.array([0.003, 0.0, -0.004]))
    assert node_error_m(aside) == pytest.approx(0.005)


def test_a_scale_has_round_ends_that_hold_what_is_shown_and_stay_for_small_changes() -> None:
    scale = Scale(CURVATURE)
    levels = scale.levels(np.linspace(0, 7.3, 500))
    assert (scale.low, scale.high) == (0.0, 8.0)
    assert levels.max() == pytest.approx(BANDS * 7.3 / 8)
    scale.levels(np.linspace(0, 6.0, 500))
    assert scale.high == 8.0
    scale.levels(np.linspace(0, 1.0, 500))
    assert scale.high < 3.0
    heights = Scale(HEIGHT)
    heights.levels(np.linspace(-0.12, 0.31, 500))
    assert heights.low <= -116
    assert heights.high >= 297
    assert "height" in heights.legend()
    assert "mm" in heights.legend()
