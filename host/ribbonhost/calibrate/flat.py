"""Refreshes biases and mountings with the ribbon flat on a table: what drifts first, in a minute.

The ribbon lies straight on one table, on either side and either way round, so that all its sensors share an
attitude as on a bar. Each parameter moves from where the calibration in use has it by no more than parts
drift; scales and soft iron hardly do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ribbonhost import wire
from ribbonhost.calibrate import reading_checks, solution_checks
from ribbonhost.calibrate.bar import Result, pose_averages, temperature_range
from ribbonhost.calibrate.consistency import disagreement_deg, orientation_sigma_deg
from ribbonhost.calibrate.place import Place
from ribbonhost.calibrate.readings import Readings
from ribbonhost.calibrate.record import parameters_of, record_of
from ribbonhost.calibrate.sensor_errors import STANDARD_GRAVITY_MPS2, Prior
from ribbonhost.calibrate.straight_bar import refine

POSES_MIN = 3
DRIFT = Prior(
    accel_bias_mps2=0.2,
    accel_scale=1e-3,
    accel_cross_axis=1e-3,
    field_bias_ut=5.0,
    field_scale=3e-3,
    field_cross_axis=2e-3,
    mounting_rad=0.005,
    face_rad=0.005,
)
"""How far parts drift in months, and how flat a ribbon lies without a bar."""
FLAT_RAD = np.radians(0.2)
"""How flat and straight a ribbon lies on a table."""


def calibrate_flat(
    readings: Readings,
    in_use: wire.Calibration,
    place: Place,
    *,
    created_s: int,
    temperatures_c: Sequence[float] = (),
) -> Result:
    """The calibration in use, refreshed. Raises RefusedError."""
    solution_checks.check_calibrated(in_use.created_s)
    reading_checks.check_readings(readings, temperatures_c)
    axes, pitch_m = int(in_use.mag_axes), float(in_use.pitch_m)
    poses, stays = pose_averages(readings, place.field_ut, axes, pitch_m)
    reading_checks.check_stays(stays, POSES_MIN)
    # A ribbon is flat to a few tenths of a degree, which is what its sensors may differ by.
    poses = replace(
        poses,
        accel_sigma_mps2=np.hypot(poses.accel_sigma_mps2, FLAT_RAD * STANDARD_GRAVITY_MPS2),
        field_sigma_ut=np.hypot(poses.field_sigma_ut, FLAT_RAD * place.field_ut),
    )
    start = parameters_of(in_use)
    solution = refine(poses, start, DRIFT)
    solution_checks.check_refreshed(solution)
    held_out = np.zeros(len(poses), dtype=bool)
    held_out[1::3] = True
    rest = refine(poses.part(~held_out), start, DRIFT)
    kept_back = poses.part(held_out)
    old_deg = disagreement_deg(kept_back, start, place.field_ut)
    new_deg = disagreement_deg(kept_back, rest.parameters, place.field_ut)
    solution_checks.check_gain(new_deg, old_deg, int(held_out.sum()))
    return Result(
        "flat",
        record_of(
            solution.parameters, field_strength_ut=place.field_ut, pitch_m=pitch_m, created_s=created_s
        ),
        solution,
        poses,
        place,
        orientation_sigma_deg(solution, place.field_ut),
        old_deg,
        new_deg,
        int(held_out.sum()),
        temperature_range(temperatures_c),
    )
