"""What disturbs the magnetic field in one place is told there, and does little harm elsewhere."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from ribbonhil.disturbances import CarriedMagnet
from ribbonhil.scenes import load_scene
from ribbonhil.truth import CombTruth, Field, comb_truth
from ribbonhil.world import disturbed
from ribbonhost.reconstruct import CombLayout, CombSolver
from ribbonhost.wire import Orient, Quality
from system.test_two_axes import Session

EARTH = Field()
SHARE = 0.2  # of the field that is added
RIBBONS, RIBBON, NODES = 5, 2, (6, 7, 8)
DISTANCE_M = 0.008  # of the magnets: their field ends before the next node, 50 mm away
SETTLED_S, END_S = 2.5, 4.5
EVERY = 10
FIELD_REASONS = int(Quality.FIELD_MAGNITUDE | Quality.FIELD_DIP)


def magnets(axis: int, sign: float) -> list[CarriedMagnet]:
    """Clips on three nodes; each adds SHARE of the earth's field at its node, along an axis of that."""
    # B = mu_0 / 4 pi * m / r^3 beside a dipole, twice that along it.
    moment = SHARE * EARTH.strength_ut * DISTANCE_M**3 / 0.1 / (2 if axis == 2 else 1)
    vector = [0.0, 0.0, 0.0]
    vector[axis] = sign * moment
    return [
        CarriedMagnet(RIBBON, 2 * node + 1, (0.0, 0.0, DISTANCE_M), (vector[0], vector[1], vector[2]))
        for node in NODES
    ]


@dataclass(frozen=True)
class Heard:
    """What a host hears of a ribbon whose field is disturbed from SETTLED_S on; t_s: true times of scans."""

    t_s: NDArray[np.float64]
    orients: list[Orient]

    @property
    def flagged(self) -> NDArray[np.bool_]:
        """(T, n) whether a node's field is told to be disturbed."""
        return np.array([(packet.nodes.quality & FIELD_REASONS) != 0 for packet in self.orients])


def heard(truth: CombTruth, felt: CombTruth, index: int, axes: int) -> Heard:
    session = Session(truth.ribbon(index), index)
    session.run_until(0.5)
    session.measure_axes(axes)
    session.run_until(SETTLED_S)
    start_us = session.ribbon.device_us
    session.ribbon.feel(felt.ribbon(index))
    packets = [packet for packet in session.run_until(END_S) if isinstance(packet, Orient)]
    since_us = np.array([(packet.t_us - start_us) % 2**32 for packet in packets], np.float64)
    return Heard(SETTLED_S + since_us * 1e-6, packets)


def error_percent_away(truth: CombTruth, ribbons: list[Heard]) -> float:
    """E of all nodes of the ribbons on the reference but the disturbed ones."""
    solver = CombSolver(CombLayout(truth.pitch_m, 16, truth.start_m))
    away = np.ones((RIBBONS + 1, 16), bool)
    away[RIBBON, list(NODES)] = False
    errors = []
    for frame in range(0, min(len(ribbon.orients) for ribbon in ribbons), EVERY):
        nodes = [ribbon.orients[frame].nodes for ribbon in ribbons]
        solved = solver.solve(
            np.array([node.q_world_node for node in nodes]), np.array([node.valid for node in nodes])
        )
        t_s = float(np.mean([ribbon.t_s[frame] for ribbon in ribbons]))
        off_m = np.linalg.norm(solved.node_m - truth.node_from_anchor_m(t_s), axis=-1)
        errors.append(off_m[1:][away[1:]].mean())
    return 100 * float(np.mean(errors)) / 0.775


@pytest.mark.parametrize("axes", [3, 2])
@pytest.mark.parametrize("scene", ["wing", "breath"])
def test_a_disturbance_of_three_nodes_is_told_there_and_harms_nothing_else(scene: str, axes: int) -> None:
    truth = comb_truth(load_scene(scene), RIBBONS, EARTH)
    ribbons = [heard(truth, truth, index, axes) for index in range(RIBBONS + 1)]
    assert not any(ribbon.flagged.any() for ribbon in ribbons)
    limit_percent = 1.5 * error_percent_away(truth, ribbons)
    for axis, sign in ((0, 1.0), (1, -1.0)):
        felt = disturbed(truth, EARTH, magnets(axis, sign))
        added_ut = np.linalg.norm(felt.field_ut - truth.field_ut, axis=-1)
        assert added_ut[:, RIBBON, [13, 15, 17]] == pytest.approx(SHARE * EARTH.strength_ut, rel=0.05)
        assert np.delete(added_ut, RIBBON, axis=1).max() < 0.1, "the others feel nothing of it"
        ribbons[RIBBON] = heard(truth, felt, RIBBON, axes)
        flagged = ribbons[RIBBON].flagged
        assert flagged[ribbons[RIBBON].t_s > SETTLED_S + 0.5][:, NODES].all()
        assert np.delete(flagged, NODES, axis=1).mean() < 0.05
        assert error_percent_away(truth, ribbons) < limit_percent
