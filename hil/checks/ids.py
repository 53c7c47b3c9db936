"""Who the device is, what it found on its string, and whether it started as it should."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from enum import IntEnum
from typing import TypeVar

from ribbonhil.check.bench import Bench
from ribbonhil.check.check import Measurement, Topic, none_of
from ribbonhost.wire import (
    SCHEMA_HASH,
    WIRE_VERSION,
    Board,
    ClockSource,
    Part,
    ResetCause,
    SlotReason,
)

TOPIC = Topic("ids")

ACCELEROMETERS = (Part.LIS2DW12,)
MAGNETOMETERS = (Part.MMC5983MA, Part.HMC5983)
BAD_STARTS = (ResetCause.WATCHDOG, ResetCause.BROWN_OUT, ResetCause.HARD_FAULT)
GOOD_CLOCKS = (ClockSource.CRYSTAL, ClockSource.HOST)

E = TypeVar("E", bound=IntEnum)


def name(kind: type[E], value: int) -> str:
    """What an enumeration calls a value."""
    return kind(value).name.lower() if value in set(kind) else f"unknown ({int(value)})"


@TOPIC.check
def identity(bench: Bench) -> Iterator[Measurement]:
    """The serial number is one, and firmware and this host were built from one schema: what they say to each
    other means the same to both."""
    unique_id = bytes(bench.info.unique_id)
    erased = unique_id in (bytes(12), b"\xff" * 12)
    is_set = "erased" if erased else "set"
    yield Measurement("serial number", is_set, expected="set", where=unique_id.hex())
    yield Measurement("board", name(Board, bench.info.board))
    yield Measurement("firmware", ".".join(str(number) for number in bench.info.firmware_version))
    yield Measurement("wire version", str(bench.info.wire_version), expected=str(WIRE_VERSION))
    yield Measurement("schema", f"{bench.info.schema_hash:08x}", expected=f"{SCHEMA_HASH:08x}")


@TOPIC.check
def parts(bench: Bench) -> Iterator[Measurement]:
    """Every slot holds a part, accelerometers and magnetometers take turns, and all of a kind are the same: a
    slot that is missing, or soldered with another part, is found here."""
    found = bench.info.slots.part
    for what, first, kind in (("accelerometers", 0, ACCELEROMETERS), ("magnetometers", 1, MAGNETOMETERS)):
        here = [int(part) for part in found[first::2]]
        most, count = Counter(here).most_common(1)[0] if here else (int(Part.NONE), 0)
        yield Measurement(what, f"{count} {name(Part, most)}")
        yield none_of(
            f"{what} missing or other",
            (
                f"slot {first + 2 * place}: {name(Part, part)}"
                for place, part in enumerate(here)
                if part != most or part not in kind
            ),
        )
    yield Measurement("nodes", bench.info.node_count, low=1, high=len(found) // 2)


@TOPIC.check
def health(bench: Bench) -> Iterator[Measurement]:
    """STATUS tells no fault: every slot is used, the last start was not a crash, a crystal keeps the time.
    Readings that do not fit together are no fault before the first calibration: they are told."""
    _, status = bench.device.get_status()
    reasons = {
        slot: int(reason) for slot, reason in enumerate(status.slots.reason) if reason != SlotReason.OK
    }
    told = {slot: f"slot {slot}: {name(SlotReason, reason)}" for slot, reason in reasons.items()}
    yield none_of("slots not used", (told[slot] for slot in told if reasons[slot] not in bench.well))
    uncalibrated = [told[slot] for slot in told if reasons[slot] in bench.well]
    if uncalibrated:
        yield Measurement("slots that need a calibration", len(uncalibrated), where=", ".join(uncalibrated))
    cause = status.reset_cause
    crashed = cause in BAD_STARTS or status.fault_pc != 0
    how = f"{name(ResetCause, cause)}{f', fault at {status.fault_pc:#010x}' if status.fault_pc else ''}"
    yield Measurement("last start", "a crash" if crashed else "in order", expected="in order", where=how)
    clock = name(ClockSource, status.clock_source)
    yield Measurement("clock", clock, expected=clock if status.clock_source in GOOD_CLOCKS else "crystal")
    if bench.is_calibrated:
        yield none_of(
            "slots that their calibration does not fit",
            (f"slot {slot}" for slot, misfit in enumerate(status.health.misfit) if misfit),
        )
