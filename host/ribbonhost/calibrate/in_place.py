"""Finds hard iron that has changed from a ribbon in use, which nobody needs to handle.

Wherever the ribbon is still, gravity at a magnetometer is known from the accelerometers around it, and
with it the circle on which the field must lie, whichever heading the node has. The offset of each
magnetometer is moved to where its readings lie on their circles best (least squares, headings eliminated);
nothing else is changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.calibrate import reading_checks, solution_checks
from ribbonhost.calibrate.bar import Result, temperature_range
from ribbonhost.calibrate.place import Place
from ribbonhost.calibrate.readings import Readings, mended
from ribbonhost.calibrate.record import parameters_of
from ribbonhost.calibrate.sensor_errors import STANDARD_GRAVITY_MPS2, Array, Parameters, Poses, Solution

SAMPLES_MIN = 40
SAMPLES_MAX = 600
LEVEL_SHARE = 0.02
"""|a| of a node that is still differs from g by less, a share of it."""
SMOOTH_S = 0.25
FIELD_SHARE = 0.01
"""What calibration and interpolation leave of a reading's error, share of the field."""
DRIFT_UT = 20.0
HEADINGS = 48
ITERATIONS = 15
HUBER = 2.0
BLOCKS = 12


def calibrate_in_place(
    readings: Readings,
    in_use: wire.Calibration,
    place: Place,
    *,
    created_s: int,
    temperatures_c: Sequence[float] = (),
) -> Result:
    """The calibration in use with the offsets of its magnetometers found anew. Raises RefusedError."""
    solution_checks.check_calibrated(in_use.created_s)
    reading_checks.check_readings(readings, temperatures_c)
    parameters = parameters_of(in_use)
    up, field_ut, usable = _still(mended(readings)[0], parameters)
    few = usable.sum(axis=0)
    reading_checks.check_still_samples(int(few.min()), SAMPLES_MIN)
    block = np.arange(len(up)) * BLOCKS // len(up)
    odd = block % 2 == 1
    shift, covariance = _offsets(up, field_ut, usable, parameters, place.field_ut)
    sigma_ut = np.sqrt(np.linalg.eigvalsh(covariance)[:, -1])
    reading_checks.check_variety(sigma_ut)
    trained, _ = _offsets(up, field_ut, usable & odd[:, None], parameters, place.field_ut)
    kept_back = usable & ~odd[:, None]
    old_deg = _misfit_deg(up, field_ut, kept_back, parameters, np.zeros_like(trained), place.field_ut)
    new_deg = _misfit_deg(up, field_ut, kept_back, parameters, trained, place.field_ut)
    solution_checks.check_gain(new_deg, old_deg, BLOCKS // 2)
    offset = np.array(in_use.slots.offset, dtype=np.float64)
    axes = parameters.field_bias_ut.shape[1]
    offset[1::2, :axes] += shift
    record = replace(
        in_use,
        created_s=created_s,
        slots=wire.SlotCalibrationArray(offset=offset, matrix=in_use.slots.matrix),
    )
    return Result(
        "in-place",
        record,
        _solution(readings, parameters, shift, covariance),
        _no_poses(readings, axes, place.field_ut),
        place,
        np.degrees(sigma_ut / (place.field_ut * max(np.cos(parameters.dip_rad), 0.1))),
        old_deg,
        new_deg,
        BLOCKS // 2,
        temperature_range(temperatures_c),
    )


def _still(readings: Readings, parameters: Parameters) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Up at each magnetometer (T, M, 3) in the node frame, its reading (T, M, axes), whether it is usable."""
    scans = max(1, round(SMOOTH_S * readings.rate_hz))
    count = len(readings) // scans
    accel = readings.accel_mps2[: count * scans].reshape(count, scans, -1, 3).mean(axis=1)
    axes = parameters.field_bias_ut.shape[1]
    field = readings.field_ut[: count * scans, :, :axes].reshape(count, scans, -1, axes).mean(axis=1)
    inverse = np.linalg.inv(parameters.accel_matrix)
    level = np.einsum("aij,taj->tai", inverse, accel - parameters.accel_bias_mps2)
    beyond = 1.5 * level[:, -1:] - 0.5 * level[:, -2:-1]
    up = np.concatenate([0.5 * (level[:, :-1] + level[:, 1:]), beyond], axis=1)[:, : field.shape[1]]
    size = np.linalg.norm(up, axis=2)
    usable = np.abs(size / STANDARD_GRAVITY_MPS2 - 1) < LEVEL_SHARE
    chosen = np.linspace(0, count - 1, min(count, SAMPLES_MAX)).astype(int)
    return up[chosen] / size[chosen, :, None], field[chosen], usable[chosen]


def _offsets(
    up: Array, field_ut: Array, usable: NDArray[np.bool_], parameters: Parameters, strength_ut: float
) -> tuple[Array, Array]:
    """Changes of the offsets (M, axes) and their covariances (M, axes, axes)."""
    axes = field_ut.shape[2]
    shift = np.zeros((field_ut.shape[1], axes))
    sigma_ut = FIELD_SHARE * strength_ut
    prior = np.eye(axes) * (sigma_ut / DRIFT_UT) ** 2
    for _ in range(ITERATIONS):
        residual, tangent = _nearest(up, field_ut, parameters, shift, strength_ut)
        size = np.linalg.norm(residual, axis=2) / sigma_ut
        weight = usable * np.minimum(1.0, HUBER / np.maximum(size, 1e-9))
        # What a heading explains tells nothing of the offset.
        across = np.eye(axes) - tangent[..., :, None] * tangent[..., None, :]
        normal = np.einsum("tm,tmij->mij", weight, across)
        right = np.einsum("tm,tmij,tmj->mi", weight, across, residual) - shift @ prior
        shift = shift + np.linalg.solve(normal + prior, right[..., None])[..., 0]
    return shift, np.asarray(np.linalg.inv(normal + prior) * sigma_ut**2)


def _nearest(
    up: Array, field_ut: Array, parameters: Parameters, shift: Array, strength_ut: float
) -> tuple[Array, Array]:
    """Reading minus the nearest that some heading explains (T, M, axes), and how heading moves it, unit."""
    first = np.where(np.abs(up[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = first - np.sum(first * up, axis=-1, keepdims=True) * up
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(up, first)
    horizontal, down = strength_ut * np.cos(parameters.dip_rad), strength_ut * np.sin(parameters.dip_rad)

    def seen(v: Array) -> Array:
        return np.asarray(np.einsum("mij,tmj->tmi", parameters.field_matrix, v))

    a, b = horizontal * seen(first), horizontal * seen(second)
    rest = field_ut - (parameters.field_bias_ut + shift) + down * seen(up)
    turns = np.linspace(0, 2 * np.pi, HEADINGS, endpoint=False)
    cost = np.stack(
        [np.sum((rest - np.cos(turn) * a - np.sin(turn) * b) ** 2, axis=-1) for turn in turns], axis=-1
    )
    turn = turns[np.argmin(cost, axis=-1)][..., None]
    for _ in range(4):
        error = rest - np.cos(turn) * a - np.sin(turn) * b
        slope = np.cos(turn) * b - np.sin(turn) * a
        turn = turn + np.sum(error * slope, axis=-1, keepdims=True) / np.maximum(
            np.sum(slope**2, axis=-1, keepdims=True), 1e-9
        )
    error = rest - np.cos(turn) * a - np.sin(turn) * b
    slope = np.cos(turn) * b - np.sin(turn) * a
    return error, slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-9)


def _misfit_deg(
    up: Array,
    field_ut: Array,
    usable: NDArray[np.bool_],
    parameters: Parameters,
    shift: Array,
    strength_ut: float,
) -> float:
    residual, _ = _nearest(up, field_ut, parameters, shift, strength_ut)
    return float(np.degrees(np.sqrt(np.mean(np.sum(residual**2, axis=2)[usable])) / strength_ut))


def _solution(readings: Readings, parameters: Parameters, shift: Array, covariance: Array) -> Solution:
    mags, axes = shift.shape
    full = np.zeros((mags * axes, mags * axes))
    for k in range(mags):
        full[k * axes : (k + 1) * axes, k * axes : (k + 1) * axes] = covariance[k]
    bias = parameters.field_bias_ut + shift
    return Solution(
        parameters=replace(parameters, field_bias_ut=bias),
        values=bias.ravel(),
        covariance=full,
        names=tuple(f"slot{2 * k + 1}.bias_{'xyz'[axis]}_ut" for k in range(mags) for axis in range(axes)),
        r_world_bar=np.zeros((0, 3, 3)),
        accel_residual=np.zeros((0, readings.accel_mps2.shape[1], 3)),
        field_residual=np.zeros((0, mags, axes)),
        face_residual=np.zeros((0, 2)),
        chi2_per_dof=1.0,
    )


def _no_poses(readings: Readings, axes: int, field_ut: float) -> Poses:
    return Poses(
        np.zeros((0, readings.accel_mps2.shape[1], 3)),
        np.zeros((0, readings.field_ut.shape[1], axes)),
        np.zeros(0),
        np.zeros(0),
        field_ut,
    )
