"""Refuses readings and poses that no calibration can be made of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.calibrate.readings import Readings
from ribbonhost.calibrate.refusals import Reason, RefusedError, listed, slot_name
from ribbonhost.calibrate.sensor_errors import Array, Poses
from ribbonhost.calibrate.stillness import Stay

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
OFFSET_MAX_UT = 1.0


def check_readings(readings: Readings, temperatures_c: Sequence[float] = ()) -> None:
    """Refuses readings that no poses can be made of."""
    back = np.flatnonzero((np.diff(readings.t_s) <= 0) | (np.diff(readings.scan) <= 0))
    if len(back):
        raise RefusedError(
            Reason.RESTARTED,
            f"the ribbon started anew after {readings.t_s[back[0]]:.0f} s: look at its supply and its plugs "
            "(`ribbonhost info` says why it last started), then begin again",
        )
    total = len(readings) + readings.lost
    if len(readings) == 0 or readings.lost > LOST_SHARE * total or readings.rate_hz < RATE_MIN_HZ:
        share = 100 * readings.lost / max(total, 1)
        raise RefusedError(
            Reason.LOST_SCANS,
            f"{len(readings)} scans came at {readings.rate_hz:g} Hz and {share:.0f} % were lost: the link "
            f"must carry RAW at {RATE_MIN_HZ:g} Hz or more without loss; try a lower --rate or a faster link",
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
        "look at its solder joints, for a ribbon is calibrated with all its sensors or not at all; "
        "`ribbonhost info` shows the state of all slots",
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


def check_variety(sigma_ut: Array) -> None:
    """Refuses an in-place calibration where nodes turned too little; sigma_ut (M,) of their offsets."""
    bad = np.flatnonzero(sigma_ut > OFFSET_MAX_UT)
    if len(bad):
        raise RefusedError(
            Reason.ONE_AXIS,
            f"{listed('node', bad + 1)} turned too little to tell a magnetometer's offset to "
            f"{OFFSET_MAX_UT:g} uT (to {sigma_ut.max():.1f} uT now): move the ribbon through more attitudes, "
            "slowly, or for longer",
        )


def check_still_samples(found: int, needed: int) -> None:
    """Refuses an in-place calibration of a ribbon that was hardly ever still."""
    if found < needed:
        raise RefusedError(
            Reason.MOTION,
            f"the ribbon was still for {found} quarters of a second where at least {needed} are needed: "
            "move it slower, or record for longer",
        )
