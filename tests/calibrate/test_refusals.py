"""Bad data are refused, each kind with its own reason and one sentence that says what to do."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from calibrate.handled import calibrate, devices, recorded, stays, troubled, turned
from ribbonhil.handling import Trouble
from ribbonhost.bench.calibration import PLACE
from ribbonhost.calibrate.readings import Readings
from ribbonhost.calibrate.refusals import Reason, RefusedError
from ribbonhost.calibrate.solution_checks import check_calibrated, check_certainty
from ribbonhost.wire import SlotReason

SLOTS = 32
PLACES = (np.arange(SLOTS) - (SLOTS - 1) / 2) / (SLOTS - 1)


def with_reason(reason: SlotReason, slot: int) -> Readings:
    readings = recorded()[1]
    name = "field_reason" if slot % 2 else "accel_reason"
    reasons = getattr(readings, name).copy()
    reasons[::3, slot // 2] = reason
    return replace(readings, **{name: reasons})


def lost_scans() -> Readings:
    readings = recorded()[1]
    kept = np.arange(len(readings)) % 10 > 0
    names = ("t_s", "accel_mps2", "accel_reason", "field_ut", "field_reason", "scan")
    return replace(readings, **{name: getattr(readings, name)[kept] for name in names})


def restarted() -> Readings:
    readings = recorded()[1]
    half = len(readings) // 2
    t_s, scan = readings.t_s.copy(), readings.scan.copy()
    t_s[half:] -= t_s[half]
    scan[half:] -= scan[half]
    return replace(readings, t_s=t_s, scan=scan)


def few_poses() -> Readings:
    readings = recorded()[1]
    end = stays()[9].last
    names = ("t_s", "accel_mps2", "accel_reason", "field_ut", "field_reason", "scan")
    return replace(readings, **{name: getattr(readings, name)[:end] for name in names})


def swaying() -> Readings:
    """Every second pose turns by 5 degrees while it is held."""
    readings = recorded()[1]
    angle = np.zeros(len(readings))
    for stay in stays()[::2]:
        angle[stay.first : stay.last] = np.radians(5) * np.sin(np.arange(stay.last - stay.first) / 12)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.moveaxis(np.array([[c, -s, 0 * c], [s, c, 0 * c], [0 * c, 0 * c, 1 + 0 * c]]), 2, 0)
    accel, field = (
        np.einsum("tij,tnj->tni", turn, values) for values in (readings.accel_mps2, readings.field_ut)
    )
    return replace(readings, accel_mps2=accel, field_ut=field)


def disturbed() -> Readings:
    """A magnet stands by in two poses: its field in the bar frame, stronger at one end."""
    readings = recorded()[1]
    field = readings.field_ut.copy()
    for pose in (3, 15):
        stay = stays()[pose]
        field[stay.first - 50 : stay.last + 50] += np.linspace(2.0, 9.0, 16)[:, None] * [0.6, -0.7, 0.3]
    return replace(readings, field_ut=field)


def loose() -> Readings:
    """An accelerometer that is turned a little differently in every pose."""
    readings = recorded()[1]
    accel = readings.accel_mps2.copy()
    random = np.random.default_rng(4)
    for stay in stays():
        accel[stay.first - 40 : stay.last + 40, 4] += random.normal(0, 0.3, 3)
    return replace(readings, accel_mps2=accel)


def tilted() -> Readings:
    """Something lies under the bar in one of the poses on the table."""
    readings = recorded()[1]
    angle = np.radians(2.0)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    accel, field = readings.accel_mps2.copy(), readings.field_ut.copy()
    errors = devices()[0].errors
    assert errors is not None
    stay = stays()[10]
    window = slice(stay.first - 20, stay.last + 20)
    for values, first in ((accel, 0), (field, 1)):
        matrix, bias = errors.matrix[first::2], errors.total_bias[first::2]
        change = matrix @ turn @ np.linalg.inv(matrix)
        values[window] = np.einsum("nij,tnj->tni", change, values[window] - bias) + bias
    return replace(readings, accel_mps2=accel, field_ut=field)


def along(axis: int, ends_deg: float) -> Readings:
    rotation = np.zeros((SLOTS, 3))
    rotation[:, axis] = np.radians(ends_deg) * PLACES
    return turned(recorded()[1], rotation)


CASES: dict[Reason, tuple[Callable[[], Readings], str]] = {
    Reason.LOST_SCANS: (lost_scans, "10 % were lost"),
    Reason.RESTARTED: (restarted, "the ribbon started anew after 48 s"),
    Reason.DEAD_SLOT: (
        lambda: with_reason(SlotReason.ABSENT, 5),
        r"slot 5 \(magnetometer 3\) was absent in 33 %",
    ),
    Reason.STUCK_SENSOR: (lambda: with_reason(SlotReason.STUCK, 8), r"slot 8 \(accelerometer 5\) was stuck"),
    Reason.SATURATED: (
        lambda: with_reason(SlotReason.SATURATED, 9),
        r"slot 9 \(magnetometer 5\) was saturated",
    ),
    Reason.MOTION: (swaying, r"in \d+ of 24 poses the bar moved"),
    Reason.TOO_FEW: (few_poses, "10 poses were held and at least 16 are needed"),
    Reason.ONE_AXIS: (lambda: troubled(Trouble(one_axis=True)), "turns about one axis, the bar's own length"),
    Reason.DISTURBED_FIELD: (disturbed, "another in poses 4 and 16 of 24"),
    Reason.SENSOR_DISAGREES: (loose, r"slot 8 \(accelerometer 5\) contradicts all others"),
    Reason.NOT_FLAT: (tilted, "did not lie flat"),
    Reason.BENT_BAR: (lambda: along(1, 6.0), r"the bar is bent: its ends point \d\.\d deg apart"),
    Reason.TWISTED_RIBBON: (lambda: along(0, 8.0), "turns about itself by"),
}


@pytest.mark.parametrize("reason", CASES)
def test_bad_data_are_refused_with_their_own_sentence(reason: Reason) -> None:
    readings, sentence = CASES[reason]
    with pytest.raises(RefusedError, match=sentence) as refused:
        calibrate(readings())
    assert refused.value.reason is reason
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) > 60, "it says what to do"


def test_a_temperature_that_changed_is_refused() -> None:
    with pytest.raises(RefusedError, match=r"changed by 7.5 degC") as refused:
        calibrate(recorded()[1], temperatures_c=[21.0, 24.0, 28.5])
    assert refused.value.reason is Reason.TEMPERATURE


def test_a_field_that_is_not_that_of_the_place_is_refused() -> None:
    with pytest.raises(RefusedError, match=r"dips 62.0 deg here where 20.0 deg") as refused:
        calibrate(recorded()[1], place=replace(PLACE, dip_deg=20.0))
    assert refused.value.reason is Reason.WRONG_FIELD


def test_what_is_too_uncertain_or_was_never_calibrated_is_refused() -> None:
    with pytest.raises(RefusedError, match=r"0.70 deg where 0.5 are allowed.*table") as refused:
        check_certainty(0.7, 2)
    assert refused.value.reason is Reason.UNCERTAIN
    with pytest.raises(RefusedError, match="calibrate bar") as refused:
        check_calibrated(0)
    assert refused.value.reason is Reason.NOT_CALIBRATED
