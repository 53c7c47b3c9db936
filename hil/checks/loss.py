"""What gets lost between sensor and host, at the highest rate with all packets that the link carries."""

from __future__ import annotations

from collections.abc import Iterator

from ribbonhil.check.bench import Bench
from ribbonhil.check.check import Measurement, Topic
from ribbonhil.check.readings import ScanKind, scans_of
from ribbonhil.conformance.device import Recording
from ribbonhost.wire import Mode, Orient, OrientCompact, Raw

TOPIC = Topic("loss")

COUNTER_MODULUS = 1 << 32
KINDS = {Mode.ORIENT: Orient, Mode.ORIENT_COMPACT: OrientCompact, Mode.RAW: Raw}


@TOPIC.check
def link(bench: Bench) -> Iterator[Measurement]:
    """Every scan's packets arrive whole: gaps in the sequence, wrong CRCs and frames that the device gave up
    are each zero. A loose wire, a bad ground or a link that is too slow shows here, in both directions."""
    recording = bench.stream(bench.carried_hz)
    names = " and ".join(kind.__name__ for flag, kind in KINDS.items() if flag in recording.mode)
    scans = rises(recording, "scans")
    load = f"{names} at {recording.rate_hz} Hz"
    yield Measurement("scans done meanwhile", scans, low=1, where=load)
    for flag, kind in KINDS.items():
        if flag in recording.mode:
            came, missing, repeated = sequence_of(recording, kind)
            yield Measurement(f"{kind.__name__} packets", came, low=1)
            yield Measurement(f"{kind.__name__} missing in sequence", missing, high=0)
            yield Measurement(f"{kind.__name__} repeated or out of order", repeated, high=0)
    spoiled = [frame.problem for frame in recording.frames if frame.problem]
    yield Measurement("frames spoiled on the way here", len(spoiled), high=0, where=", ".join(set(spoiled)))
    for what, counter in (
        ("frames given up by the device", "frames_dropped"),
        ("frames to the device with a wrong CRC", "rx_crc_errors"),
        ("frames to the device malformed", "rx_malformed"),
    ):
        yield Measurement(what, rises(recording, counter), high=0)


@TOPIC.check
def overruns(bench: Bench) -> Iterator[Measurement]:
    """No scan is left out because the one before took too long, at any rate: the device has time to spare."""
    for rate_hz in bench.rates_hz:
        recording = bench.stream(rate_hz)
        yield Measurement(f"scans left out at {rate_hz} Hz", rises(recording, "overruns"), high=0)
        yield Measurement(f"a scan takes, at {rate_hz} Hz", recording.after.scan_us, "us", high=1e6 / rate_hz)


def rises(recording: Recording, counter: str) -> int:
    """By how much a counter of STATUS rose."""
    before, after = getattr(recording.before, counter), getattr(recording.after, counter)
    return int((after - before) % COUNTER_MODULUS)


def sequence_of(recording: Recording, kind: ScanKind) -> tuple[int, int, int]:
    """How many packets of a kind came, how many numbers are missing, how many came again or too late."""
    number = scans_of(recording, kind).number
    steps = number[1:] - number[:-1]
    return len(number), int((steps[steps > 1] - 1).sum()), int((steps < 1).sum())
