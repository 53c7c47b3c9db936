"""Recordings that several groups of checks look at."""

from __future__ import annotations

from enum import IntEnum

from ribbonhost.wire import Mode

from ribbonhil.conformance.device import Device, Recording

RATE_HZ = 100
RECORD_S = 3.2
COMPACT_RECORD_S = 0.5
CLOCK_MODULUS = 2**32


def watch(device: Device, mode: Mode, duration_s: float) -> Recording:
    """A mode at 100 Hz, or the device's largest rate if it is less; at least three scans."""
    rate_hz = min(RATE_HZ, device.info.rate_max_hz)
    return device.record(rate_hz, mode, max(duration_s, 3.2 / rate_hz))


def both(device: Device) -> Recording:
    """ORIENT and RAW, long enough for STATUS to come by itself."""
    return watch(device, Mode.ORIENT | Mode.RAW, RECORD_S)


def compact(device: Device) -> Recording:
    """ORIENT_COMPACT."""
    return watch(device, Mode.ORIENT_COMPACT, COMPACT_RECORD_S)


def rises(recording: Recording, counter: str) -> int:
    """By how much a counter of STATUS rose over the recording."""
    return int((getattr(recording.after, counter) - getattr(recording.before, counter)) % CLOCK_MODULUS)


def one_of(enumeration: type[IntEnum]) -> str:
    """The values that are legal, for what a check expects."""
    return f"one of {', '.join(str(int(member)) for member in enumeration)}"
