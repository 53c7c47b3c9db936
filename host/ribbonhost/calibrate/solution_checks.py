"""Refuses results that fit no straight bar in one place, are too uncertain, or no better than before."""

from __future__ import annotations

import numpy as np

from ribbonhost.calibrate.refusals import Reason, RefusedError, listed, slot_name
from ribbonhost.calibrate.sensor_errors import Array, Poses, Solution

OUTSTANDING = 4.0
"""Residuals of a pose or a sensor, over those of most."""
RESIDUAL_MIN = 3.0
ALONE = 2.0
CHI2_MAX = 4.0
TREND_SIGMAS = 4.5
FACE_SIGMAS = 4.5
FIELD_SHARE = 0.15
DIP_DEG = 10.0
SIGMA_MAX_DEG = 0.5
REFRESHED_MAX = 4.0


def check_solution(poses: Poses, solution: Solution, field_cost: Array, dip_deg: float | None) -> None:
    """Refuses what does not fit a straight bar in one place.

    field_cost: (P, M) how badly the field of each pose fits where those that fit worst count least.
    dip_deg: what it should be at the place; None: not known.
    """
    _check_sensors(solution)
    _check_poses(np.median(field_cost, axis=1))
    _check_faces(poses, solution)
    _check_trends(poses, solution)
    if solution.chi2_per_dof > CHI2_MAX:
        raise RefusedError(
            Reason.UNEXPLAINED,
            f"the readings fit no straight bar: they miss by {np.sqrt(solution.chi2_per_dof):.1f} times "
            "their noise in all poses; is the ribbon held to the bar along all its length, and the field "
            "free of motors?",
        )
    _check_field(solution, dip_deg)


def _check_poses(field_cost: Array) -> None:
    off = np.sqrt(field_cost / max(float(np.median(field_cost)), 1.0))
    bad = np.flatnonzero(off > OUTSTANDING)
    if len(bad):
        raise RefusedError(
            Reason.DISTURBED_FIELD,
            f"the magnetic field was another in {listed('pose', bad + 1)} of {len(off)}, up to "
            f"{off.max():.0f} times what noise explains: keep away from steel, phones and the edge of the "
            "table, and do these again",
        )


def _check_sensors(solution: Solution) -> None:
    rms = np.empty(solution.accel_residual.shape[1] + solution.field_residual.shape[1])
    rms[0::2] = np.sqrt(np.median(np.mean(solution.accel_residual**2, axis=2), axis=0))
    rms[1::2] = np.sqrt(np.median(np.mean(solution.field_residual**2, axis=2), axis=0))
    worst, second = np.argsort(rms)[:-3:-1]
    # A magnet near the bar disturbs several.
    if rms[worst] > max(OUTSTANDING * np.median(rms), ALONE * rms[second], RESIDUAL_MIN):
        raise RefusedError(
            Reason.SENSOR_DISAGREES,
            f"{slot_name(int(worst))} contradicts all others, by {rms[worst]:.0f} times its noise: is the "
            "ribbon loose on the bar there, or the part on the ribbon?",
        )


def _check_faces(poses: Poses, solution: Solution) -> None:
    off = np.abs(solution.face_residual).max(axis=1)
    if off.max(initial=0.0) > FACE_SIGMAS:
        pose = int(np.argmax(off))
        raise RefusedError(
            Reason.NOT_FLAT,
            f"in pose {pose + 1} the bar did not lie flat on the table on which it lay before: use one "
            "flat table and a bar with parallel sides, and lay nothing under it",
        )


def _check_trends(poses: Poses, solution: Solution) -> None:
    names, values = np.array(solution.names), solution.values
    slots = np.array([int(name[4:].split(".")[0]) if name.startswith("slot") else -1 for name in names])
    pitch_m = (
        float(np.diff(poses.accel_m).mean()) / 2 if len(poses.accel_m) > 1 and poses.accel_m.any() else 1.0
    )
    for axis in "xyz":
        mine = np.char.endswith(names, f"mounting_{axis}")
        place, mounting = slots[mine] - slots[mine].mean(), values[mine]
        slope = float(place @ mounting / (place @ place))
        rest = mounting - mounting.mean() - slope * place
        sigma = float(np.sqrt(rest @ rest / (len(rest) - 2) / (place @ place)))
        ends_deg = abs(np.degrees(slope * np.ptp(place)))
        if abs(slope) < TREND_SIGMAS * sigma:
            continue
        if axis == "x":
            raise RefusedError(
                Reason.TWISTED_RIBBON,
                f"the ribbon turns about itself by {ends_deg:.1f} deg from one end of the bar to the other: "
                "tape it flat along its whole length",
            )
        sag_mm = 1e3 * np.radians(ends_deg) * np.ptp(place) * pitch_m / 8
        raise RefusedError(
            Reason.BENT_BAR,
            f"the bar is bent: its ends point {ends_deg:.1f} deg apart, {sag_mm:.0f} mm in the middle; take "
            "a stiff one (square aluminium tube, 15 mm or more)",
        )


def _check_field(solution: Solution, dip_deg: float | None) -> None:
    gain = float(np.mean(np.linalg.norm(solution.parameters.field_matrix, axis=2)))
    if abs(gain - 1) > FIELD_SHARE:
        raise RefusedError(
            Reason.WRONG_FIELD,
            f"the magnetometers read {100 * (gain - 1):+.0f} % of the field that was given for this place: "
            "check --place or --field-ut, and keep away from steel",
        )
    found_deg = float(np.degrees(solution.parameters.dip_rad))
    if dip_deg is not None and abs(found_deg - dip_deg) > DIP_DEG:
        raise RefusedError(
            Reason.WRONG_FIELD,
            f"the field dips {found_deg:.1f} deg here where {dip_deg:.1f} deg are expected: check --place or "
            "--dip-deg, and keep away from steel",
        )


def check_certainty(sigma_deg: float, lying: int) -> None:
    """Refuses a result that says orientations worse than SIGMA_MAX_DEG."""
    if not sigma_deg <= SIGMA_MAX_DEG:
        table = "" if lying >= 4 else "; lay the bar on a table on two sides, each turned end for end, too"
        raise RefusedError(
            Reason.UNCERTAIN,
            f"these poses leave orientations uncertain by {sigma_deg:.2f} deg where {SIGMA_MAX_DEG:g} are "
            f"allowed: hold the bar in more and other attitudes{table}",
        )


def check_gain(new_deg: float, old_deg: float, held_out: int) -> None:
    """Refuses a calibration that poses which it was not made of find no better than that in use."""
    if not new_deg < old_deg:
        raise RefusedError(
            Reason.NOT_BETTER,
            f"in {held_out} poses kept back for it, sensors disagree by {new_deg:.3f} deg with the new "
            f"calibration and by {old_deg:.3f} deg with the one in use: that one stays",
        )


def check_calibrated(created_s: int) -> None:
    """Refuses to refresh what was never made."""
    if created_s == 0:
        raise RefusedError(
            Reason.NOT_CALIBRATED,
            "the ribbon has no calibration yet that could be refreshed: begin with "
            "`ribbonhost calibrate bar`",
        )


def check_refreshed(solution: Solution) -> None:
    """Refuses sensors that changed by more than parts drift, and a ribbon that does not lie flat."""
    rms = np.sqrt(
        np.mean(solution.accel_residual**2, axis=(0, 2)).sum() / solution.accel_residual.shape[1]
        + np.mean(solution.field_residual**2, axis=(0, 2)).sum() / solution.field_residual.shape[1]
    )
    if rms > REFRESHED_MAX:
        raise RefusedError(
            Reason.UNEXPLAINED,
            f"the readings fit no ribbon that lies flat and straight, {rms:.1f} times as far as they may: "
            "lay it flat, away from steel; if it is so, calibrate it on a bar",
        )
