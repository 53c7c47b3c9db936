"""Ribbons handled for a calibration: attitudes, stillness, and each of the troubles that it can have."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from ribbonhil.handling import HANDLINGS, Handling, Trouble, handled_truth
from ribbonhil.ribbon import EmulatedRibbon
from ribbonhil.rotations import rotation_vectors
from ribbonhil.truth import GRAVITY_MPS2, CombTruth, Field
from ribbonhost.errors import UsageError

Array = NDArray[np.float64]
EARTH = Field()
BAR = Handling(hold_s=2.0)
UP_MPS2 = np.array([0.0, 0.0, GRAVITY_MPS2])


def truth_of(handling: Handling) -> CombTruth:
    return handled_truth(handling, 1, EARTH)


def held(handling: Handling, truth: CombTruth, pose: int) -> slice:
    """The rows in which a pose is held."""
    rows_per_s = len(truth.position_m) / handling.period_s
    start_s, end_s = handling.holds_s()[pose]
    return slice(int(np.ceil(start_s * rows_per_s)), int(end_s * rows_per_s))


def angle_deg(a: Array, b: Array) -> Array:
    """Angle between rotation matrices (..., 3, 3)."""
    turn = rotation_vectors(np.swapaxes(a, -1, -2) @ b)
    return np.asarray(np.degrees(np.linalg.norm(turn, axis=-1)))


@pytest.mark.parametrize("poses", [12, 24, 40])
def test_attitudes_are_spread(poses: int) -> None:
    attitudes = replace(BAR, poses=poses).attitudes()
    apart_deg = angle_deg(attitudes[:, None], attitudes[None]) + 180 * np.eye(poses)
    assert apart_deg.min() > 20
    for axis in range(3):
        up = attitudes[:, 2, axis]
        assert up.max() > 0.9, "each axis of the bar points up once"
        assert up.min() < -0.9


def test_a_held_bar_is_still_as_hands_hold_it() -> None:
    truth = truth_of(BAR)
    assert truth.position_m.shape[1:] == (2, 32, 3)
    for pose in range(2, 24, 5):
        rows = held(BAR, truth, pose)
        force = truth.specific_force_mps2[rows, 0]
        off_mps2 = np.linalg.norm(force, axis=-1) - GRAVITY_MPS2
        assert 0.005 < off_mps2.std() < 0.06, "tens of mm/s^2"
        attitude = BAR.attitudes()[pose]
        off_deg = angle_deg(attitude, truth.r_world_node[rows, 0, 0])
        assert 0.02 < off_deg.mean() < 1.0, "tenths of a degree"


def test_forces_are_those_of_the_motion() -> None:
    truth = truth_of(BAR)
    position_m, r = truth.position_m[:, 0], truth.r_world_node[:, 0]
    step_s = BAR.period_s / len(position_m)
    acceleration = (np.roll(position_m, -1, 0) - 2 * position_m + np.roll(position_m, 1, 0)) / step_s**2
    felt = np.einsum("ksij,ksi->ksj", r, acceleration + UP_MPS2)
    off = np.abs(felt - truth.specific_force_mps2[:, 0])
    assert off.max() < 0.1, "differences of a step of 16 ms"
    assert off.mean() < 0.005
    assert np.abs(np.linalg.norm(truth.field_ut, axis=-1) - EARTH.strength_ut).max() < 1e-9


def test_sensors_of_a_straight_bar_agree() -> None:
    r = truth_of(BAR).r_world_node[:, 0]
    assert np.abs(r - r[:, :1]).max() < 1e-12


def test_the_handling_repeats_without_a_jump() -> None:
    truth = truth_of(BAR)
    step_m = np.linalg.norm(np.diff(truth.position_m[:, 0], axis=0, append=truth.position_m[:1, 0]), axis=-1)
    assert step_m[-1].max() <= step_m.max()
    assert step_m.max() < 0.05, "less than 3 m/s"


def test_a_bent_bar_and_a_twisted_ribbon_turn_sensors_apart() -> None:
    bent = truth_of(replace(BAR, trouble=Trouble(bend_1pm=0.5))).r_world_node[0, 0]
    twisted = truth_of(replace(BAR, trouble=Trouble(twist_radpm=0.4))).r_world_node[0, 0]
    length_m = 31 * 0.025
    assert angle_deg(bent[0], bent[-1]) == pytest.approx(np.degrees(0.5 * length_m))
    assert angle_deg(twisted[0], twisted[-1]) == pytest.approx(np.degrees(0.4 * length_m))
    assert np.abs(twisted[..., 0] - twisted[0, :, 0]).max() < 1e-12, "about the tangent"


def test_troubles_touch_what_they_say() -> None:
    fine = truth_of(BAR)
    disturbed = truth_of(replace(BAR, trouble=Trouble(disturbed=(3, 4))))
    difference_ut = np.linalg.norm(disturbed.field_ut - fine.field_ut, axis=-1)[:, 0]
    assert difference_ut[held(BAR, fine, 3)].max() > 3.0
    assert difference_ut[held(BAR, fine, 4)].max() > 3.0
    assert not difference_ut[held(BAR, fine, 6)].any()

    loose = truth_of(replace(BAR, trouble=Trouble(loose_slot=6)))
    difference = np.abs(loose.specific_force_mps2 - fine.specific_force_mps2)[:, 0].max(axis=-1)
    assert max(difference[held(BAR, fine, pose), 6].min() for pose in (1, 3)) > 0.2
    assert not difference[held(BAR, fine, 2)].any()
    assert not np.delete(difference, 6, axis=1).any()

    saturated = truth_of(replace(BAR, trouble=Trouble(saturated_slot=5)))
    assert np.abs(saturated.field_ut[:, 0, 5]).max(axis=-1).min() > 800.0, "8 gauss"

    turned = replace(BAR, trouble=Trouble(one_axis=True), scatter_deg=0.0).attitudes()
    assert np.abs(turned[:, :, 0] - turned[0, :, 0]).max() < 1e-12


def test_a_ribbon_at_rest_rests() -> None:
    truth = truth_of(HANDLINGS["rest"])
    assert np.ptp(truth.specific_force_mps2, axis=0).max() < 1e-9
    assert 8.0 < truth.specific_force_mps2[0, 0, 0, 2] < 9.81


def test_a_bar_takes_no_period() -> None:
    with pytest.raises(UsageError, match="bar has no period to choose"):
        EmulatedRibbon("bar", 0, ribbons=1, period_s=3.0)


def test_handling_can_be_had_by_its_name() -> None:
    ribbon = EmulatedRibbon("bar", 0, ribbons=1, part_errors=1)
    assert ribbon.device.errors is not None
    ribbon.run_until(1.0)
    assert ribbon.read()


def test_on_the_table_a_bar_is_still_and_flush_whichever_end_is_where() -> None:
    truth, lies = truth_of(BAR), np.flatnonzero(BAR.lies())
    assert list(lies) == [0, 1, 10, 11]
    up = BAR.attitudes()[lies, 2]
    for pose in lies:
        force = truth.specific_force_mps2[held(BAR, truth, pose), 0]
        # The rows around the hold belong to the moves to and from it.
        assert np.ptp(force[2:-2], axis=0).max() < 2e-3, "m/s^2"
    for side, (one, other) in ((2, (0, 2)), (1, (1, 3))):
        tilt = np.degrees(up[[one, other]][:, [0, 3 - side]])
        assert np.abs(tilt[0] + tilt[1]).max() < 4 * BAR.flush_deg, (
            "turned about the vertical, tilts change sign"
        )
        assert np.abs(up[[one, other], side]).min() > np.cos(np.radians(BAR.table_deg + 1))
    assert not Handling(table_deg=np.nan).lies().any()
