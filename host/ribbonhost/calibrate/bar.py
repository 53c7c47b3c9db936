"""The straight bar from readings to a calibration that may be used, or a reason why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.calibrate import reading_checks, solution_checks
from ribbonhost.calibrate.consistency import disagreement_deg, orientation_sigma_deg
from ribbonhost.calibrate.place import Place
from ribbonhost.calibrate.readings import Readings, mended
from ribbonhost.calibrate.record import parameters_of, record_of, strength_ut
from ribbonhost.calibrate.sensor_errors import Array, Poses, Solution
from ribbonhost.calibrate.stillness import Stay, average, find_stays
from ribbonhost.calibrate.straight_bar import robust_field_cost, solve, solve_again

HELD_OUT_EVERY = 5
GOOD_SHARE = 0.7
"""Of the readings of each sensor in a pose."""


@dataclass(frozen=True)
class Result:
    """A calibration that passed all checks.

    Attributes:
        method: bar, flat or in-place.
        record: what the device is to use.
        solution: the parameters with their covariance, and the residuals; poses: what they rest on.
        place: the field that they are made for.
        sigma_deg: (M,) what their uncertainty leaves of orientations.
        old_deg, new_deg: disagreement of sensors in `held_out` poses with the calibration in use, and with
            one made without these poses.
        temperature_c: (lowest, highest) meanwhile; NaN if not known.
    """

    method: str
    record: wire.Calibration
    solution: Solution
    poses: Poses
    place: Place
    sigma_deg: Array
    old_deg: float
    new_deg: float
    held_out: int
    temperature_c: tuple[float, float]


def pose_averages(readings: Readings, field_ut: float, axes: int, pitch_m: float) -> tuple[Poses, list[Stay]]:
    """The poses that were held, and all stays, also those that are no poses."""
    readings, good = mended(readings)
    stays = [
        replace(
            stay, still=stay.still and bool(np.all(good[stay.first : stay.last].mean(axis=0) > GOOD_SHARE))
        )
        for stay in find_stays(readings)
    ]
    return average(readings, [stay for stay in stays if stay.still], field_ut, axes, pitch_m), stays


def calibrate_bar(
    readings: Readings,
    in_use: wire.Calibration,
    place: Place,
    *,
    axes: int,
    pitch_m: float,
    created_s: int,
    temperatures_c: Sequence[float] = (),
    force: bool = False,
) -> Result:
    """The calibration that readings of a straight bar give.

    force: also if it is no better than that in use. Raises RefusedError.
    """
    reading_checks.check_readings(readings, temperatures_c)
    poses, stays = pose_averages(readings, place.field_ut, axes, pitch_m)
    reading_checks.check_stays(stays, reading_checks.POSES_MIN)
    reading_checks.check_attitudes(poses)
    solution = solve(poses, dip_rad=None if place.dip_deg is None else np.radians(place.dip_deg))
    solution_checks.check_solution(poses, solution, robust_field_cost(poses, solution), place.dip_deg)
    sigma_deg = orientation_sigma_deg(solution, place.field_ut)
    lying = np.linalg.norm(poses.up_face, axis=1) > 0.5
    solution_checks.check_certainty(float(np.max(sigma_deg)), int(lying.sum()))
    held_out = _held_out(lying)
    old_deg = disagreement_deg(poses.part(held_out), parameters_of(in_use, axes), strength_ut(in_use))
    rest = solve_again(poses, solution, ~held_out)
    new_deg = disagreement_deg(poses.part(held_out), rest.parameters, place.field_ut)
    if not force:
        solution_checks.check_gain(new_deg, old_deg, int(held_out.sum()))
    return Result(
        "bar",
        record_of(
            solution.parameters, field_strength_ut=place.field_ut, pitch_m=pitch_m, created_s=created_s
        ),
        solution,
        poses,
        place,
        sigma_deg,
        old_deg,
        new_deg,
        int(held_out.sum()),
        temperature_range(temperatures_c),
    )


def temperature_range(temperatures_c: Sequence[float]) -> tuple[float, float]:
    """(lowest, highest); NaN if there is none."""
    return (min(temperatures_c), max(temperatures_c)) if len(temperatures_c) else (np.nan, np.nan)


def _held_out(lying: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(P,) every so many of the poses that were held by hand; of all if those are few."""
    kept_back = np.zeros(len(lying), dtype=bool)
    held = np.flatnonzero(~lying) if np.count_nonzero(~lying) >= 2 * HELD_OUT_EVERY else np.arange(len(lying))
    kept_back[held[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY]] = True
    return kept_back
