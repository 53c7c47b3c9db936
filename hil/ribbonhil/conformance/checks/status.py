"""STATUS: the device's health, once a second and when asked."""

from __future__ import annotations

import math
from itertools import pairwise

from ribbonhost.wire import (
    WIRE_VERSION,
    ClockSource,
    CommandCode,
    Misfit,
    Mode,
    Part,
    ResetCause,
    SlotReason,
    Status,
)

from ribbonhil.conformance.check import Group, NotObservedError, expect
from ribbonhil.conformance.checks.recordings import CLOCK_MODULUS, both, one_of, rises, watch
from ribbonhil.conformance.client import ACK_LIMIT_S, Frame
from ribbonhil.conformance.device import Device

GROUP = Group("status")

INTERVAL_TOLERANCE_S = 0.1
QUIET_S = 2.3
TEMPERATURE_RANGE_C = (-55.0, 150.0)
ALL_MISFITS = Misfit.LENGTH | Misfit.NEIGHBOURS | Misfit.DIP
# Counters that never go back but by wrapping.
COUNTERS = (
    "uptime_s",
    "scans",
    "overruns",
    "frames_dropped",
    "rx_crc_errors",
    "rx_malformed",
    "rx_unknown",
)


def pairs(device: Device) -> list[tuple[Frame, Status, Status]]:
    """(frame of the later, earlier, later) of neighbouring STATUS packets of a recording."""
    found = both(device).of(Status)
    expect(len(found) >= 2, "STATUS packets", len(found))
    return [(frame, old, new) for (_, old), (frame, new) in pairwise(found)]


@GROUP.check("STATUS")
def get_status_sends_status(device: Device) -> None:
    """get_status is answered by an ACK and then a STATUS packet."""
    # Several, as the STATUS of the second may come by chance.
    for _ in range(5):
        reply = device.accepted(CommandCode.GET_STATUS)
        found = device.wait_for(lambda f: isinstance(f.packet, Status), reply.place, ACK_LIMIT_S)
        expect(found is not None, "a STATUS after the ACK", f"none in {ACK_LIMIT_S} s", reply.frame)


@GROUP.check("STATUS")
def status_comes_once_a_second(device: Device) -> None:
    """A STATUS comes once a second, streaming or quiet."""
    for mode in (Mode.ORIENT | Mode.RAW, Mode(0)):
        recording = both(device) if mode else watch(device, mode, QUIET_S)
        # The first and the last were asked for.
        unasked = recording.of(Status)[1:-1]
        expect(len(unasked) >= 2, "STATUS each second", f"{len(unasked)} in mode {int(mode)}")
        for (_, old), (frame, new) in pairwise(unasked):
            took_s = (new.t_us - old.t_us) % CLOCK_MODULUS / 1e6
            expect(abs(took_s - 1.0) <= INTERVAL_TOLERANCE_S, "1 s between them", f"{took_s:.3f} s", frame)


@GROUP.check("STATUS")
def counters_never_go_back(device: Device) -> None:
    """The counters of STATUS, those of the slots included, only rise."""
    for frame, old, new in pairs(device):
        for name in COUNTERS:
            rise = (getattr(new, name) - getattr(old, name)) % CLOCK_MODULUS
            expect(
                rise < CLOCK_MODULUS // 2,
                f"{name} not to fall",
                f"{getattr(old, name)} to {getattr(new, name)}",
                frame,
            )
        for slot, (low, high) in enumerate(
            zip(old.slots.errors.tolist(), new.slots.errors.tolist(), strict=True)
        ):
            expect(low <= high, f"errors of slot {slot} not to fall", f"{low} to {high}", frame)


@GROUP.check("STATUS")
def scans_are_counted(device: Device) -> None:
    """scans rises by the rate times the time, less overruns, also while nothing is sent."""
    for recording in (both(device), watch(device, Mode(0), QUIET_S)):
        took_s = (recording.after.t_us - recording.before.t_us) % CLOCK_MODULUS / 1e6
        done = round(took_s * recording.rate_hz) - rises(recording, "overruns")
        told = rises(recording, "scans")
        expect(abs(told - done) <= 2, f"scans to rise by {done} in mode {int(recording.mode)}", told)


@GROUP.check("STATUS")
def uptime_follows_the_clock(device: Device) -> None:
    """uptime_s rises as t_us does."""
    recording = both(device)
    took_s = (recording.after.t_us - recording.before.t_us) % CLOCK_MODULUS / 1e6
    rise_s = (recording.after.uptime_s - recording.before.uptime_s) % CLOCK_MODULUS
    expect(abs(rise_s - took_s) <= 1.0, f"uptime_s to rise by {took_s:.2f} s within 1 s", rise_s)


@GROUP.check("STATUS")
def status_follows_rate_and_mode(device: Device) -> None:
    """rate_hz and mode are those in use."""
    for rate_hz, mode in ((device.info.rate_max_hz, Mode.RAW), (1, Mode.ORIENT_COMPACT)):
        device.set(rate_hz, mode)
        frame, status = device.get_status()
        expect(
            (status.rate_hz, status.mode) == (rate_hz, mode),
            f"rate {rate_hz} Hz, mode {int(mode)}",
            f"rate {status.rate_hz} Hz, mode {int(status.mode)}",
            frame,
        )


@GROUP.check("STATUS")
def scan_time_fits_the_rate(device: Device) -> None:
    """scan_us is not 0, and less than a period as long as no scan was left out."""
    recording = both(device)
    period_us = 1e6 / recording.rate_hz
    for frame, old, new in pairs(device):
        expect(new.scan_us > 0, "a scan to take time", new.scan_us, frame)
        if new.overruns == old.overruns:
            expect(new.scan_us < period_us, f"less than {period_us:g} us", new.scan_us, frame)


@GROUP.check("STATUS")
def slots_are_as_many_as_in_info(device: Device) -> None:
    """STATUS has as many slots as INFO."""
    wanted = len(device.info.slots)
    frame, status = device.get_status()
    seen = len(status.slots)
    expect(seen == wanted, f"{wanted} slots", seen, frame)


@GROUP.check("STATUS")
def slot_reasons_are_legal(device: Device) -> None:
    """Each slot has a reason of the enumeration, and one other than ok where INFO knows no part."""
    _, info = device.get_info()
    frame, status = device.get_status()
    for slot, (part, reason) in enumerate(
        zip(info.slots.part.tolist(), status.slots.reason.tolist(), strict=False)
    ):
        expect(reason in set(SlotReason), one_of(SlotReason), f"{reason} in slot {slot}", frame)
        missing = part == Part.NONE
        expect(not (missing and reason == SlotReason.OK), "a reason but ok: no part", f"ok in {slot}", frame)


@GROUP.check("STATUS")
def status_enumerations_are_known(device: Device) -> None:
    """A device of this wire version gives a reset_cause and a clock_source of the enumerations."""
    if device.info.wire_version != WIRE_VERSION:
        raise NotObservedError(
            f"the device speaks wire version {device.info.wire_version}, this suite {WIRE_VERSION}"
        )
    frame, status = device.get_status()
    expect(status.reset_cause in set(ResetCause), one_of(ResetCause), status.reset_cause, frame)
    expect(status.clock_source in set(ClockSource), one_of(ClockSource), status.clock_source, frame)


@GROUP.check("STATUS")
def fault_record_needs_a_fault(device: Device) -> None:
    """fault_pc, fault_lr and fault_cfsr are 0 unless a hard fault was the reset_cause."""
    frame, status = device.get_status()
    if status.reset_cause != ResetCause.HARD_FAULT:
        fault = (status.fault_pc, status.fault_lr, status.fault_cfsr)
        expect(fault == (0, 0, 0), "no fault record", [f"{word:08x}" for word in fault], frame)


@GROUP.check("STATUS")
def temperature_is_possible(device: Device) -> None:
    """temperature_c is marked invalid, or between -55 and 150 degrees Celsius."""
    frame, status = device.get_status()
    low_c, high_c = TEMPERATURE_RANGE_C
    expect(
        math.isnan(status.temperature_c) or low_c <= status.temperature_c <= high_c,
        f"{low_c:g} to {high_c:g} degC, or invalid",
        f"{status.temperature_c:g} degC",
        frame,
    )


@GROUP.check("STATUS")
def health_is_of_all_slots_or_none(device: Device) -> None:
    """STATUS has the health of every slot, or of none, and no bits of misfit that are not defined."""
    frame, status = device.get_status()
    slots = len(status.slots)
    expect(len(status.health) in (0, slots), f"the health of 0 or {slots} slots", len(status.health), frame)
    unknown = [int(misfit) for misfit in status.health.misfit if int(misfit) & ~int(ALL_MISFITS)]
    expect(not unknown, "bits of misfit that are defined", unknown, frame)


@GROUP.check("STATUS")
def slots_without_readings_are_not_judged(device: Device) -> None:
    """A slot whose reason is not ok has no misfit."""
    frame, status = device.get_status()
    for slot, (reason, misfit) in enumerate(zip(status.slots.reason, status.health.misfit, strict=False)):
        expect(reason == SlotReason.OK or misfit == 0, f"no misfit in slot {slot}", int(misfit), frame)
