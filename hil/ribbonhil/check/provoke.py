"""Who makes the faults that a ribbon must notice: an emulator that injects them, or a person's hand."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Protocol

from ribbonhost.wire import SlotReason

from ribbonhil.comb_spec import parse_url
from ribbonhil.emulator import EmulatedComb
from ribbonhil.faults import BUS, Fault, FaultKind

HOLD_S = 1.5
"""How long an injected fault lasts: longer than it may take to be noticed and asked about."""


@dataclass(frozen=True)
class Provocation:
    """A fault that is made on purpose.

    Attributes:
        what: what is wrong, and with which slot.
        slots: the slots that it strikes.
        reasons: what the device may say of them.
        kind, place: the same as an emulated fault.
    """

    what: str
    slots: tuple[int, ...]
    reasons: frozenset[SlotReason]
    kind: FaultKind
    place: int


class Provoker(Protocol):
    """Makes faults and ends them.

    Attributes:
        patience_s: how long it may take from start until the fault is there and noticed.
        end_remark: how the end of a fault is timed.
    """

    patience_s: float
    end_remark: str

    def provocations(self, slots: int) -> Sequence[Provocation]:
        """What it can do to a ribbon of so many slots."""

    def start(self, provocation: Provocation) -> float | None:
        """Makes the fault; returns when it began, on the clock of the link, or None if that is not known."""

    def stop(self, provocation: Provocation) -> float:
        """Ends it; returns when it was over, or will be, on the clock of the link."""


def line_open(slots: int) -> Provocation:
    """The wire that all slots answer on, or the plug of the string, is open."""
    reasons = frozenset({SlotReason.ABSENT})
    return Provocation("MISO open", tuple(range(slots)), reasons, FaultKind.MISO_HIGH, BUS)


class Injector:
    """Tells an emulator which faults to make."""

    patience_s = 2.0
    end_remark = "from its end"

    def __init__(self, inject: Callable[[FaultKind, int, float], float]) -> None:
        """inject(kind, slot, duration_s) makes a fault at once; returns when it will be over."""
        self._inject = inject
        self._over_s = 0.0

    def provocations(self, slots: int) -> Sequence[Provocation]:
        accelerometer, magnetometer = 2 * (slots // 4), slots - 1
        no_power = frozenset({SlotReason.ABSENT, SlotReason.NOT_CONFIGURED})
        stuck = frozenset({SlotReason.STUCK})
        return (
            Provocation(
                f"accelerometer {accelerometer} unpowered",
                (accelerometer,),
                no_power,
                FaultKind.ABSENT,
                accelerometer,
            ),
            Provocation(
                f"magnetometer {magnetometer} stuck",
                (magnetometer,),
                stuck,
                FaultKind.STUCK,
                magnetometer,
            ),
            line_open(slots),
        )

    def start(self, provocation: Provocation) -> float | None:
        self._over_s = self._inject(provocation.kind, provocation.place, HOLD_S)
        return self._over_s - HOLD_S

    def stop(self, provocation: Provocation) -> float:
        return self._over_s


class Person:
    """Asks somebody at the ribbon to open a wire and to close it again."""

    patience_s = 60.0
    end_remark = "from Enter"

    def provocations(self, slots: int) -> Sequence[Provocation]:
        return (line_open(slots),)

    def start(self, provocation: Provocation) -> float | None:
        self._say("Pull the wire of MISO, or the plug of the string, from the board, and leave it out.")
        return None

    def stop(self, provocation: Provocation) -> float:
        self._say("The ribbon has noticed. Put it back, then press Enter at once.")
        sys.stdin.readline()
        return time.monotonic()

    @staticmethod
    def _say(text: str) -> None:
        print(f"\n{text}", file=sys.stderr, flush=True)


def injector_of(url: str, comb: EmulatedComb) -> Injector:
    """For a ribbon at an emulated:// URL, whose comb runs in this process."""
    index = parse_url(url).index

    def inject(kind: FaultKind, slot: int, duration_s: float) -> float:
        start_s = time.monotonic() - comb.start_host_s
        comb.add_fault(index, Fault(kind, slot, start_s, start_s + duration_s))
        return comb.start_host_s + start_s + duration_s

    return Injector(inject)


def comb_of(url: str) -> EmulatedComb:
    """The comb that the ports of an emulated:// URL belong to. Raises UsageError for another URL."""
    return EmulatedComb(**asdict(parse_url(url).comb))
