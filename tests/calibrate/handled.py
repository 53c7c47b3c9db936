"""An emulated ribbon with the errors of real parts, turned on a bar by emulated hands: recorded once."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from ribbonhil.emulated_device import Device
from ribbonhil.handling import Handling, Trouble
from ribbonhost import wire
from ribbonhost.bench.calibration import PLACE, drawn_devices, handled_readings
from ribbonhost.calibrate.bar import Result, calibrate_bar
from ribbonhost.calibrate.readings import Readings
from ribbonhost.calibrate.stillness import Stay, find_stays
from scipy.spatial.transform import Rotation

SEED = 3
PITCH_M = 0.025
BAR = Handling(seed=SEED, hold_s=3.0)


@lru_cache(maxsize=1)
def devices() -> list[Device]:
    return drawn_devices(SEED)


@lru_cache(maxsize=1)
def recorded() -> tuple[wire.Info, Readings, wire.Calibration]:
    """INFO, readings of 24 poses, and the calibration in use: none."""
    return handled_readings(devices()[0], devices(), 0, BAR)


@lru_cache(maxsize=4)
def troubled(trouble: Trouble) -> Readings:
    return handled_readings(devices()[0], devices(), 0, replace(BAR, trouble=trouble))[1]


@lru_cache(maxsize=1)
def calibrated() -> Result:
    return calibrate(recorded()[1])


def calibrate(readings: Readings, in_use: wire.Calibration | None = None, **options: object) -> Result:
    place = options.pop("place", PLACE)
    return calibrate_bar(
        readings,
        in_use or recorded()[2],
        place,  # type: ignore[arg-type]
        axes=2,
        pitch_m=PITCH_M,
        created_s=1,
        **options,  # type: ignore[arg-type]
    )


@lru_cache(maxsize=1)
def stays() -> list[Stay]:
    return find_stays(recorded()[1])


def turned(readings: Readings, rotation_rad: NDArray[np.float64]) -> Readings:
    """The readings of parts that are turned by rotation vectors (S, 3) as well: exact, by their errors."""
    errors = devices()[0].errors
    assert errors is not None
    matrix, bias = errors.matrix, errors.total_bias
    turn = Rotation.from_rotvec(rotation_rad).as_matrix()
    change = matrix @ turn.swapaxes(1, 2) @ np.linalg.inv(matrix)

    def seen(values: NDArray[np.float64], first: int) -> NDArray[np.float64]:
        rest = values - bias[first::2]
        return np.einsum("nij,tnj->tni", change[first::2], rest) + bias[first::2]

    return replace(readings, accel_mps2=seen(readings.accel_mps2, 0), field_ut=seen(readings.field_ut, 1))
