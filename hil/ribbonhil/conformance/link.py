"""The link as the suite sees it: bytes out, bytes in, and the clock that times both."""

from __future__ import annotations

import queue
import time
from typing import Protocol

from ribbonhost.errors import LinkLostError
from ribbonhost.link import open_link


class Link(Protocol):
    """A byte link with its own clock, so that a responder in virtual time needs no waiting.

    Attributes:
        opened_s: when opening it began: what a device sent later is not lost.
    """

    opened_s: float

    def now_s(self) -> float:
        """Monotonic seconds of the host."""

    def write(self, data: bytes) -> None:
        """Sends all of `data`. Raises LinkLostError."""

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        """What has arrived, as soon as there is any, and when it did; empty after `timeout_s`.

        Raises LinkLostError.
        """

    def close(self) -> None:
        """Gives the link back."""


class SerialLink:
    """Any pyserial port or URL, emulated:// included, in real time."""

    def __init__(self, url: str, baud: int) -> None:
        """Raises UsageError if `url` is no port, LinkError if it cannot be opened."""
        self.opened_s = self.now_s()
        self._arrived: queue.SimpleQueue[tuple[bytes, float] | LinkLostError] = queue.SimpleQueue()
        self._link = open_link(url, baud=baud)
        self._link.start(lambda data, t_host_s: self._arrived.put((data, t_host_s)), self._arrived.put)

    def now_s(self) -> float:
        return time.monotonic()

    def write(self, data: bytes) -> None:
        self._link.write(data)

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        try:
            item = self._arrived.get(timeout=max(timeout_s, 0.0))
        except queue.Empty:
            return b"", self.now_s()
        if isinstance(item, LinkLostError):
            raise item
        return item

    def close(self) -> None:
        self._link.close()
