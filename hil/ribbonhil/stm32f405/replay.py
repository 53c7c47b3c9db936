"""Whether an image and the host's build of the same firmware say the same when they live through the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ribbonhil._firmware import ffi, lib
from ribbonhil.stm32f405.session import Session

READ_BYTES = 65536


@dataclass(frozen=True)
class Replay:
    """What came of a replay.

    followed: events that the host's build took part in just as the image did, of `events`.
    orients: the ORIENT packets that it sent, as sent.
    """

    events: int
    followed: int
    orients: list[bytes]

    def matches(self, orients: list[bytes]) -> bool:
        """Whether it did all that the image did, and sent the same ORIENT packets, byte for byte."""
        return self.followed == self.events and self.orients[: len(orients)] == orients and bool(orients)


class _Sent:
    """Bytes that were sent, for a session that only listens."""

    now_s = 0.0

    def run_until(self, t_s: float) -> None:
        """Nothing more happens."""

    def read(self) -> bytes:
        """Nothing more comes."""
        return b""

    def write(self, data: bytes) -> int:
        """Nobody is there."""
        return 0


def replay(log: Any, events: int) -> Replay:
    """Lets the firmware on the host board live through a log (Mcu.end_log). Raises MemoryError."""
    ribbon = lib.replayed_ribbon_new(ffi.cast("struct logged_event *", _address(log)), events)
    if ribbon == ffi.NULL:
        raise MemoryError("no memory for a replayed ribbon")
    try:
        followed = int(lib.replayed_ribbon_run(ribbon))
        session = Session(_Sent())
        buffer = ffi.new("uint8_t[]", READ_BYTES)
        while n := lib.replayed_ribbon_read(ribbon, buffer, READ_BYTES):
            session.take(bytes(ffi.buffer(buffer, n)))
    finally:
        lib.replayed_ribbon_free(ribbon)
    return Replay(events, followed, session.orients)


def _address(log: Any) -> int:
    """The log belongs to another module; both declare it with the same header."""
    from ribbonhil.stm32f405._mcu import ffi as mcu_ffi

    return int(mcu_ffi.cast("uintptr_t", log))
