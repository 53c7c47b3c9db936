"""Between the parameters of sensors and the calibration record of a device."""

from __future__ import annotations

import numpy as np

from ribbonhost import wire
from ribbonhost.calibrate.sensor_errors import Parameters


def record_of(
    parameters: Parameters, *, field_strength_ut: float, pitch_m: float, created_s: int
) -> wire.Calibration:
    """The record that undoes the errors: vector in the node frame = matrix * (reading - offset).

    With two axes the third column of a magnetometer's matrix is the direction that the part is blind to.
    """
    accels, mags = len(parameters.accel_matrix), len(parameters.field_matrix)
    offset, matrix = np.zeros((accels + mags, 3)), np.zeros((accels + mags, 3, 3))
    axes = parameters.field_matrix.shape[1]
    offset[0::2] = parameters.accel_bias_mps2
    matrix[0::2] = np.linalg.inv(parameters.accel_matrix)
    offset[1::2, :axes] = parameters.field_bias_ut
    matrix[1::2, :, :axes] = np.linalg.pinv(parameters.field_matrix)
    if axes == 2:
        blind = np.cross(parameters.field_matrix[:, 0], parameters.field_matrix[:, 1])
        matrix[1::2, :, 2] = blind / np.linalg.norm(blind, axis=1)[:, None]
    return wire.Calibration(
        layout=wire.CALIBRATION_LAYOUT,
        mag_axes=axes,
        created_s=created_s,
        pitch_m=pitch_m,
        field_horizontal_ut=field_strength_ut * float(np.cos(parameters.dip_rad)),
        field_down_ut=field_strength_ut * float(np.sin(parameters.dip_rad)),
        slots=wire.SlotCalibrationArray(offset=offset, matrix=matrix.reshape(-1, 9)),
    )


def parameters_of(calibration: wire.Calibration, axes: int | None = None) -> Parameters:
    """What a record says of the sensors, seen with its own or another number of magnetometer axes.

    Raises ValueError for a matrix without an inverse.
    """
    axes = axes or int(calibration.mag_axes)
    offset = np.asarray(calibration.slots.offset, dtype=np.float64)
    matrix = np.asarray(calibration.slots.matrix, dtype=np.float64).reshape(-1, 3, 3)
    try:
        inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise ValueError("the calibration holds a matrix without an inverse") from error
    return Parameters(
        inverse[0::2],
        offset[0::2],
        inverse[1::2, :axes],
        offset[1::2, :axes],
        float(np.arctan2(calibration.field_down_ut, calibration.field_horizontal_ut)),
    )


def strength_ut(calibration: wire.Calibration) -> float:
    """|B| that a record says."""
    return float(np.hypot(calibration.field_horizontal_ut, calibration.field_down_ut))
