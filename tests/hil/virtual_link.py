"""An emulated ribbon in virtual time at the end of a link: seconds of a run take hundredths."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ribbonhil.check.bench import Bench, Options, PingedDevice
from ribbonhil.check.check import Check
from ribbonhil.check.provoke import Injector
from ribbonhil.check.runner import Report, run, topics
from ribbonhil.faults import Fault, FaultKind
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.wire import Packet, decode, encode

STEP_S = 1e-5
ALL = tuple(check for topic in topics() for check in topic.checks)


class Ribbon(Protocol):
    """The firmware as a module, or the image."""

    @property
    def next_event_s(self) -> float: ...
    def run_until(self, t_s: float) -> None: ...
    def write(self, data: bytes) -> int: ...
    def read(self) -> bytes: ...
    def add_fault(self, fault: Fault) -> None: ...


class VirtualLink:
    """A link whose clock is the ribbon's true time. `alter` may change packets on their way, or drop them."""

    def __init__(self, ribbon: Ribbon, alter: Callable[[Packet], Packet | None] | None = None) -> None:
        self.opened_s = 0.0
        self._ribbon = ribbon
        self._alter = alter
        self._deframer = Deframer()
        self._now_s = 0.0

    def now_s(self) -> float:
        return self._now_s

    def write(self, data: bytes) -> None:
        self._ribbon.run_until(self._now_s)
        self._ribbon.write(data)

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        end_s = self._now_s + max(timeout_s, 0.0)
        while True:
            self._now_s = min(max(self._ribbon.next_event_s, self._now_s + STEP_S), end_s)
            self._ribbon.run_until(self._now_s)
            data = self._ribbon.read()
            if data or self._now_s >= end_s:
                return self._altered(data), self._now_s

    def close(self) -> None:
        pass

    def inject(self, kind: FaultKind, slot: int, duration_s: float) -> float:
        """Makes a fault now; returns when it will be over."""
        self._ribbon.add_fault(Fault(kind, slot, self._now_s, self._now_s + duration_s))
        return self._now_s + duration_s

    def _altered(self, data: bytes) -> bytes:
        if self._alter is None:
            return data
        out = b""
        for content in self._deframer.feed(data):
            packet, _ = decode(content)
            altered = self._alter(packet)
            if altered is packet:
                out += encode_frame(content)
            elif altered is not None:
                out += encode_frame(encode(altered))
        return out


def run_checks(
    link: VirtualLink,
    *names: str,
    options: Options = Options(seconds=1.2),  # noqa: B008 - frozen
    inject: bool = True,
) -> Report:
    """Runs the checks of these names or topics, all if there is none."""
    device = PingedDevice(link)
    device.start()
    chosen: tuple[Check, ...] = tuple(
        check for check in ALL if not names or check.name in names or check.topic in names
    )
    return run(Bench(device, options, Injector(link.inject) if inject else None), chosen)
