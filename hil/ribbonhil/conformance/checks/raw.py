"""RAW: all readings of a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from ribbonhost.wire import Mode, Part, Raw, SlotReason, Status

from ribbonhil.conformance.check import BrokenRuleError, Group, expect
from ribbonhil.conformance.checks.parts import COUNTS
from ribbonhil.conformance.checks.recordings import CLOCK_MODULUS, both, one_of, rises
from ribbonhil.conformance.checks.stream import scans
from ribbonhil.conformance.client import Frame
from ribbonhil.conformance.device import Device, Recording

GROUP = Group("raw")

# Where the errors of a slot stop.
ERRORS_MAX = 0xFFFF


@GROUP.check("RAW")
def raw_counts_are_as_info_says(device: Device) -> None:
    """RAW holds a reading for each slot: the even ones as accelerometers, the odd ones as magnetometers."""
    slot_count = len(device.info.slots)
    wanted = ((slot_count + 1) // 2, slot_count // 2)
    recording = both(device)
    scans(recording, Raw)
    for frame, raw in recording.of(Raw):
        seen = (len(raw.accels), len(raw.mags))
        expect(seen == wanted, f"{wanted[0]} accelerometers, {wanted[1]} magnetometers", seen, frame)


@dataclass(frozen=True)
class Readings:
    """All RAW packets of a recording: reason (packets, slots), counts (packets, slots, 3)."""

    frames: list[Frame]
    t_us: list[int]
    reason: npt.NDArray[np.uint8]
    counts: npt.NDArray[np.int32]


def readings(recording: Recording) -> Readings:
    """The readings of a recording. Raises BrokenRuleError if there are none, or of varying slots."""
    scans(recording, Raw)
    found = recording.of(Raw)
    accel_count, mag_count = len(found[0][1].accels), len(found[0][1].mags)
    for frame, raw in found:
        seen = (len(raw.accels), len(raw.mags))
        expect(
            seen == (accel_count, mag_count), f"{accel_count}, {mag_count} readings each time", seen, frame
        )
    expect(0 <= accel_count - mag_count <= 1, "as many magnetometers as accelerometers", mag_count)
    slot_count = accel_count + mag_count
    reason = np.empty((len(found), slot_count), np.uint8)
    counts = np.empty((len(found), slot_count, 3), np.int32)
    for index, (_, raw) in enumerate(found):
        reason[index, ::2], reason[index, 1::2] = raw.accels.reason, raw.mags.reason
        counts[index, ::2], counts[index, 1::2] = raw.accels.counts, raw.mags.counts
    return Readings([frame for frame, _ in found], [int(raw.t_us) for _, raw in found], reason, counts)


@GROUP.check("RAW")
def raw_counts_are_in_range(device: Device) -> None:
    """A usable reading is within the counts that its part can give."""
    raw = readings(both(device))
    for slot, part in enumerate(device.info.slots.part.tolist()[: raw.reason.shape[1]]):
        if part not in COUNTS:
            continue
        limit = COUNTS[Part(part)]
        counts = raw.counts[:, slot]
        outside = ((counts < -limit) | (counts >= limit)).any(axis=1) & (raw.reason[:, slot] == SlotReason.OK)
        for index in np.flatnonzero(outside)[:1]:
            raise BrokenRuleError(
                f"counts of {Part(part).name} in {-limit} to {limit - 1}",
                f"{counts[index].tolist()} in slot {slot}",
                raw.frames[index].coded,
            )


@GROUP.check("RAW")
def raw_reasons_are_legal(device: Device) -> None:
    """Each reading has a reason of the enumeration, and one other than ok where INFO knows no part."""
    raw = readings(both(device))
    for index, slot in np.argwhere(~np.isin(raw.reason, list(SlotReason)))[:1]:
        raise BrokenRuleError(
            one_of(SlotReason), f"{raw.reason[index, slot]} in slot {slot}", raw.frames[index].coded
        )
    parts = device.info.slots.part[: raw.reason.shape[1]]
    missing = np.flatnonzero(parts == Part.NONE)
    for index, slot in np.argwhere(raw.reason[:, missing] == SlotReason.OK)[:1]:
        raise BrokenRuleError("a reason but ok: no part", f"ok in {missing[slot]}", raw.frames[index].coded)


@GROUP.check("RAW")
def raw_ages_can_be(device: Device) -> None:
    """A reading is older than half of its span, and by at most its own period and that of scans."""
    recording = both(device)
    scans(recording, Raw)
    period_us = 1e6 / recording.rate_hz
    for frame, raw in recording.of(Raw):
        for kind in ("accel", "mag"):
            age_us, own_us, span_us = (
                getattr(raw, f"{kind}_{name}_us") for name in ("age", "period", "span")
            )
            low_us, high_us = span_us / 2, span_us / 2 + own_us + period_us
            expect(
                low_us <= age_us <= high_us,
                f"{kind}_age_us from {low_us:.0f} to {high_us:.0f}",
                age_us,
                frame,
            )


@GROUP.check("STATUS")
def slot_errors_count_unusable_readings(device: Device) -> None:
    """The errors of a slot in STATUS rise by the scans in which RAW has no usable reading of it."""
    recording = both(device)
    raw = readings(recording)
    before = recording.before
    # While RAW is sent: what is not sent cannot be counted here.
    after = [status for _, status in recording.of(Status) if Mode.RAW in status.mode][-1]
    since_us = (np.array(raw.t_us) - before.t_us) % CLOCK_MODULUS
    between = (since_us > 0) & (since_us <= (after.t_us - before.t_us) % CLOCK_MODULUS)
    unusable = (raw.reason[between] != SlotReason.OK).sum(axis=0).tolist()
    # A scan may end while STATUS is being put together, or RAW of it may have been dropped.
    slack = 1 + rises(recording, "frames_dropped")
    errors = zip(before.slots.errors.tolist(), after.slots.errors.tolist(), unusable, strict=False)
    for slot, (low, high, wanted) in enumerate(errors):
        if high < ERRORS_MAX and abs(high - low - wanted) > slack:
            raise BrokenRuleError(
                f"errors of slot {slot} to rise by {wanted}, its unusable readings in {between.sum()} scans",
                f"from {low} to {high}",
            )
