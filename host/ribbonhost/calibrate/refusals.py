"""What data give no calibration to be trusted, each with a sentence of its own that says what to do."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.calibrate.readings import Readings
from ribbonhost.calibrate.sensor_errors import Array, Poses, Solution
from ribbonhost.calibrate.stillness import Stay
from ribbonhost.errors import CalibrationError


class Reason(StrEnum):
    """The kinds of bad data."""

    LOST_SCANS = "lost_scans"
    DEAD_SLOT = "dead_slot"
    STUCK_SENSOR = "stuck_sensor"
    SATURATED = "saturated"
    TEMPERATURE = "temperature"
    MOTION = "motion"
    TOO_FEW = "too_few_attitudes"
    ONE_AXIS = "one_axis"
    DISTURBED_FIELD = "disturbed_field"
    WRONG_FIELD = "wrong_field"
    SENSOR_DISAGREES = "sensor_disagrees"
    NOT_FLAT = "not_flat"
    BENT_BAR = "bent_bar"
    TWISTED_RIBBON = "twisted_ribbon"
    UNEXPLAINED = "unexplained"
    UNCERTAIN = "uncertain"
    OTHER_RIBBON = "other_ribbon"
    NOT_BETTER = "not_better"


class RefusedError(CalibrationError):
    """Data that are refused; nothing that a device holds has changed.

    Attributes:
        reason: which kind of bad data.
    """

    def __init__(self, reason: Reason, message: str) -> None:
        super().__init__(message)
        self.reason = reason


POSES_MIN = 16
LOST_SHARE = 0.05
RATE_MIN_HZ = 15.0
UNUSABLE_SHARE = 0.2
SATURATED_SHARE = 0.02
ACCEL_MOST_MPS2 = 15.0
FIELD_MOST_UT = 300.0
TEMPERATURE_C = 5.0
SPREAD_MIN = 0.1
"""Smallest eigenvalue of the mean of u u^T over the poses; 1/3 where directions are spread evenly."""
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


def check_readings(readings: Readings, temperatures_c: Sequence[float] = ()) -> None:
    """Refuses readings that no poses can be made of."""
    total = len(readings) + readings.lost
    if len(readings) == 0 or readings.lost > LOST_SHARE * total or readings.rate_hz < RATE_MIN_HZ:
        share = 100 * readings.lost / max(total, 1)
        raise RefusedError(
            Reason.LOST_SCANS,
            f"{len(readings)} scans came at {readings.rate_hz:g} Hz and {share:.0f} % were lost: the link must "
            f"carry RAW at {RATE_MIN_HZ:g} Hz or more without loss; try a lower --rate, or a faster link",
        )
    if len(temperatures_c) and (change := max(temperatures_c) - min(temperatures_c)) > TEMPERATURE_C:
        raise RefusedError(
            Reason.TEMPERATURE,
            f"the temperature changed by {change:.1f} degC (from {min(temperatures_c):.1f} to "
            f"{max(temperatures_c):.1f}), and biases with it: let the ribbon run for ten "
            "minutes, then start over",
        )
    for slot, reasons in _by_slot(readings):
        for wanted, limit, reason, what in _UNUSABLE:
            share = float(np.mean(np.isin(reasons, wanted)))
            if share > limit:
                name = wire.SlotReason(
                    int(np.bincount(reasons[np.isin(reasons, wanted)]).argmax())
                ).name.lower()
                if reason is Reason.STUCK_SENSOR and _reads_too_much(readings, slot):
                    reason, what = Reason.SATURATED, TOO_MUCH
                raise RefusedError(
                    reason, f"{slot_name(slot)} was {name} in {100 * share:.0f} % of the scans: {what}"
                )


TOO_MUCH = "it is at the end of its range; take away magnets and magnetised tools, and do not knock the bar"

_UNUSABLE: tuple[tuple[list[int], float, Reason, str], ...] = (
    (
        [wire.SlotReason.ABSENT, wire.SlotReason.WRONG_ID, wire.SlotReason.NOT_CONFIGURED],
        UNUSABLE_SHARE,
        Reason.DEAD_SLOT,
        "look at its solder joints; `ribbonhost info` shows the state of all slots",
    ),
    (
        [wire.SlotReason.STALE, wire.SlotReason.STUCK, wire.SlotReason.NOISY],
        UNUSABLE_SHARE,
        Reason.STUCK_SENSOR,
        "switch the ribbon off and on again; if it stays so the part is broken",
    ),
    (
        [wire.SlotReason.SATURATED],
        SATURATED_SHARE,
        Reason.SATURATED,
        TOO_MUCH,
    ),
)


def slot_name(slot: int) -> str:
    """What a message calls a slot."""
    return f"slot {slot} ({'magnetometer' if slot % 2 else 'accelerometer'} {slot // 2 + 1})"


def _reads_too_much(readings: Readings, slot: int) -> bool:
    """Whether a reading that never changes is more than any that a still sensor can make."""
    if slot % 2:
        size, most = np.linalg.norm(readings.field_ut[:, slot // 2], axis=1), FIELD_MOST_UT
    else:
        size, most = np.linalg.norm(readings.accel_mps2[:, slot // 2], axis=1), ACCEL_MOST_MPS2
    return bool(np.median(size) > most)


def _by_slot(readings: Readings) -> list[tuple[int, NDArray[np.uint8]]]:
    accels = [(2 * i, reasons) for i, reasons in enumerate(readings.accel_reason.T)]
    return [*accels, *((2 * i + 1, reasons) for i, reasons in enumerate(readings.field_reason.T))]


def check_stays(stays: Sequence[Stay], needed: int) -> None:
    """Refuses too few poses, and says whether it was for want of stillness."""
    still = sum(stay.still for stay in stays)
    if still >= needed:
        return
    moved = [stay for stay in stays if not stay.still]
    if len(moved) >= max(3, still // 3):
        degrees = np.degrees([stay.wander_rad for stay in moved])
        raise RefusedError(
            Reason.MOTION,
            f"in {len(moved)} of {len(stays)} poses the bar moved, by {2 * degrees.min():.1f} to "
            f"{2 * degrees.max():.1f} deg: hold it still for two seconds in each, or lean it "
            "against something",
        )
    raise RefusedError(
        Reason.TOO_FEW,
        f"{still} poses were held and at least {needed} are needed: turn the bar to further attitudes "
        "and hold it still for two seconds in each",
    )


def check_attitudes(poses: Poses) -> None:
    """Refuses poses whose gravity does not reach all axes."""
    up = poses.accel_mps2.mean(axis=1)
    up = up / np.linalg.norm(up, axis=1)[:, None]
    _check_spread(up, "its ends, its edges and its faces up in turn")


def _check_spread(directions: Array, what: str) -> None:
    values, vectors = np.linalg.eigh(directions.T @ directions / len(directions))
    if values[0] < SPREAD_MIN:
        axis = "xyz"[int(np.argmax(np.abs(vectors[:, 0])))]
        name = {"x": "the bar's own length", "y": "its edge-to-edge axis", "z": "the normal of its face"}[
            axis
        ]
        raise RefusedError(
            Reason.ONE_AXIS,
            f"all {len(directions)} attitudes are turns about one axis, {name}: hold the bar with {what}",
        )


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
            "their noise in all poses; is the ribbon held to the bar along all its length, and the field free of "
            "motors?",
        )
    _check_field(solution, dip_deg)


def _check_poses(field_cost: Array) -> None:
    off = np.sqrt(field_cost / max(float(np.median(field_cost)), 1.0))
    bad = np.flatnonzero(off > OUTSTANDING)
    if len(bad):
        raise RefusedError(
            Reason.DISTURBED_FIELD,
            f"the magnetic field was another in {_list('pose', bad + 1)} of {len(off)}, up to "
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
            f"{slot_name(int(worst))} contradicts all others, by {rms[worst]:.0f} times its noise: is the ribbon "
            "loose on the bar there, or the part on the ribbon?",
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


def _list(noun: str, numbers: Array | NDArray[np.int64]) -> str:
    words = [str(int(number)) for number in numbers]
    if len(words) == 1:
        return f"{noun} {words[0]}"
    return f"{noun}s {', '.join(words[:-1])} and {words[-1]}"
