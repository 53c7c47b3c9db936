"""What drifts is refreshed without a bar: flat on a table, or while the ribbon is used."""

from dataclasses import replace

import numpy as np
import pytest
from calibrate.handled import calibrated, recorded, stays, turned
from ribbonhost.bench.calibration import PLACE
from ribbonhost.calibrate.flat import calibrate_flat
from ribbonhost.calibrate.in_place import calibrate_in_place
from ribbonhost.calibrate.readings import Readings
from ribbonhost.calibrate.record import parameters_of
from ribbonhost.calibrate.refusals import Reason, RefusedError

CREATED_S = 1_700_000_000


def on_the_table(readings: Readings) -> Readings:
    """Only the times at which the bar lies on the table."""
    kept = np.zeros(len(readings), dtype=bool)
    for stay in stays():
        if stay.lying:
            kept[stay.first : stay.last] = True
    names = ("t_s", "accel_mps2", "accel_reason", "field_ut", "field_reason")
    only = {name: getattr(readings, name)[kept] for name in names}
    return replace(readings, **only, scan=np.arange(int(kept.sum())))


def test_flat_rest_finds_biases_and_mountings_that_drifted() -> None:
    random = np.random.default_rng(1)
    drift_mps2 = random.normal(0, 0.1, (16, 3))
    drift_ut = random.normal(0, 2.0, (16, 3))
    drifted = turned(recorded()[1], np.radians(random.normal(0, 0.2, (32, 3))))
    drifted = replace(
        drifted, accel_mps2=drifted.accel_mps2 + drift_mps2, field_ut=drifted.field_ut + drift_ut
    )
    in_use = calibrated().record
    result = calibrate_flat(on_the_table(drifted), in_use, PLACE, created_s=CREATED_S)
    assert len(result.poses) == 4
    assert result.new_deg < 0.5 * result.old_deg
    off = result.solution.parameters.accel_bias_mps2 - parameters_of(in_use).accel_bias_mps2 - drift_mps2
    # Four poses show two axes of a part both ways up or not at all: what they do not show stays as it was.
    assert np.sqrt(np.mean(off[:, 1:] ** 2)) < 0.7 * np.sqrt(np.mean(drift_mps2[:, 1:] ** 2))
    assert result.record.created_s == CREATED_S


def test_flat_rest_needs_a_calibration_and_enough_poses() -> None:
    _, readings, never = recorded()
    with pytest.raises(RefusedError, match="begin with") as refused:
        calibrate_flat(readings, never, PLACE, created_s=CREATED_S)
    assert refused.value.reason is Reason.NOT_CALIBRATED
    first = on_the_table(readings)
    names = ("t_s", "accel_mps2", "accel_reason", "field_ut", "field_reason", "scan")
    short = replace(first, **{name: getattr(first, name)[:140] for name in names})
    with pytest.raises(RefusedError) as refused:
        calibrate_flat(short, calibrated().record, PLACE, created_s=CREATED_S)
    assert refused.value.reason is Reason.TOO_FEW


def test_in_place_finds_hard_iron_that_changed() -> None:
    change_ut = np.random.default_rng(2).normal(0, 4.0, (16, 2))
    before = calibrated().record
    readings = recorded()[1]
    field_ut = readings.field_ut.copy()
    field_ut[:, :, :2] += change_ut
    changed = replace(readings, field_ut=field_ut)
    result = calibrate_in_place(changed, before, PLACE, created_s=CREATED_S)
    found_ut = (result.record.slots.offset - before.slots.offset)[1::2, :2]
    assert np.sqrt(np.mean((found_ut - change_ut) ** 2)) < 0.2 * np.sqrt(np.mean(change_ut**2))
    assert result.new_deg < 0.5 * result.old_deg
    assert np.array_equal(result.record.slots.matrix, before.slots.matrix)
    assert np.array_equal(result.record.slots.offset[0::2], before.slots.offset[0::2])


def test_in_place_refuses_a_ribbon_that_hardly_moves() -> None:
    with pytest.raises(RefusedError, match="turned too little") as refused:
        calibrate_in_place(on_the_table_only_one(), calibrated().record, PLACE, created_s=CREATED_S)
    assert refused.value.reason is Reason.ONE_AXIS


def on_the_table_only_one() -> Readings:
    """One pose, over and over."""
    readings = recorded()[1]
    stay = stays()[0]
    names = ("t_s", "accel_mps2", "accel_reason", "field_ut", "field_reason", "scan")
    part = {name: np.concatenate([getattr(readings, name)[stay.first : stay.last]] * 10) for name in names}
    part["t_s"], part["scan"] = np.arange(len(part["scan"])) / readings.rate_hz, np.arange(len(part["scan"]))
    return replace(readings, **part)
