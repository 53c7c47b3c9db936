"""A calibration that does not fit any more is told in STATUS, slot by slot; one that fits is not."""

from dataclasses import replace

import numpy as np
import pytest
from firmware.running_ribbon import RunningRibbon
from ribbonhil.disturbances import CarriedMagnet
from ribbonhil.emulated_device import Device, drawn_device
from ribbonhil.part_errors import PartErrors, no_errors
from ribbonhil.scenes import load_scene
from ribbonhil.truth import CombTruth, Field, comb_truth
from ribbonhil.world import disturbed, load_world, world_truth
from ribbonhost.framing import crc32
from ribbonhost.wire import Calibration, CommandCode, Misfit, SlotCalibrationArray, Status

EARTH = Field()
CHUNK = 192


def status_after(
    truth: CombTruth, device: Device, seconds: float, *, errors: PartErrors | None = None, axes: int = 3
) -> Status:
    """What a ribbon says of itself when it has the calibration that takes its errors away."""
    ribbon = RunningRibbon(device, truth=truth.ribbon(0), mode=0)
    size = ribbon.accepted(CommandCode.CALIBRATION_READ).value
    record = b"".join(ribbon.accepted(CommandCode.CALIBRATION_READ, at).data for at in range(0, size, CHUNK))
    old = Calibration.unpack(record)
    values = {name: getattr(old, name) for name in Calibration.__dataclass_fields__}
    if errors is not None:
        matrix = np.linalg.inv(errors.matrix).reshape(-1, 9)
        values["slots"] = SlotCalibrationArray(offset=errors.total_bias, matrix=matrix)
    new = Calibration(**{**values, "mag_axes": axes, "created_s": 1}).pack()
    for at in range(0, size, CHUNK):
        ribbon.accepted(CommandCode.CALIBRATION_WRITE, at, new[at : at + CHUNK])
    ribbon.accepted(CommandCode.CALIBRATION_COMMIT, crc32(new))
    ribbon.run_until(seconds)
    return ribbon.status()


def of_errors(**changed: object) -> PartErrors:
    return replace(no_errors(32), **changed)  # type: ignore[arg-type]


def at_rest(device: Device) -> CombTruth:
    return world_truth(load_world("rest"), 1, EARTH, devices=[device, device])


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize(("scene", "period_s"), [("wing", 20.0), ("breath", 20.0), ("wing", 2.0)])
def test_nothing_is_found_on_a_good_ribbon(scene: str, period_s: float, axes: int) -> None:
    truth = comb_truth(load_scene(scene, period_s), 1, EARTH)
    assert not status_after(truth, drawn_device(2, 0), 15.0, axes=axes).health.misfit.any()


def test_nothing_is_found_on_a_calibrated_ribbon_and_much_on_an_uncalibrated_one() -> None:
    device = drawn_device(0, 0, part_errors=3)
    truth = at_rest(device)
    calibrated = status_after(truth, device, 8.0, errors=device.errors)
    assert not calibrated.health.misfit.any()
    assert np.abs(calibrated.health.length_permille).max() <= 2
    uncalibrated = status_after(truth, device, 8.0)
    assert np.count_nonzero(uncalibrated.health.misfit) > 5


def test_a_bias_that_drifts_with_temperature_is_found() -> None:
    drift = np.zeros((32, 3))
    drift[6] = 0.0, 0.0, 0.6e-3 * 9.80665  # three times the typical 0.2 mg/C
    errors = of_errors(bias_per_c=drift)
    cold = drawn_device(0, 0)
    warm = replace(cold, errors=errors, warming_c=30.0, warming_s=2.0)
    status = status_after(at_rest(warm), warm, 20.0, errors=errors)
    assert np.flatnonzero(status.health.misfit).tolist() == [6]
    assert status.health.misfit[6] == Misfit.LENGTH
    assert status.health.length_permille[6] == pytest.approx(18, abs=2)
    unwarmed = replace(cold, errors=errors)
    assert not status_after(at_rest(unwarmed), unwarmed, 20.0, errors=errors).health.misfit.any()


def test_an_accelerometer_that_came_loose_is_found_by_its_neighbours() -> None:
    turn_rad = np.zeros((32, 3))
    turn_rad[12, 0] = np.radians(5.0)
    device = replace(drawn_device(0, 0), errors=of_errors(mounting_rad=turn_rad))
    status = status_after(at_rest(device), device, 8.0)
    assert np.flatnonzero(status.health.misfit).tolist() == [12]
    assert status.health.misfit[12] == Misfit.NEIGHBOURS
    assert abs(status.health.length_permille[12]) <= 2, "it reads g as before"


def test_a_magnet_that_stays_near_is_found_at_its_slot() -> None:
    device = drawn_device(0, 0)
    magnet = CarriedMagnet(0, 9, (0.0, 0.0, 0.01), (0.0, 4e-5, 0.0))  # 4 uT along north
    truth = disturbed(at_rest(device), EARTH, [magnet])
    status = status_after(truth, device, 8.0)
    assert np.flatnonzero(status.health.misfit).tolist() == [9]
