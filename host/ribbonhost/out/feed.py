"""What all targets share: a thread that takes frames from the stream without ever making it wait."""

import queue
import threading
from abc import ABC, abstractmethod

from ribbonhost.pipeline.solving import Solved

QUEUE_FRAMES = 64
"""Frames that may wait to be sent; further ones are missed."""


class Feed(ABC):
    """Takes frames as one of the stream's consumers and sends them in a thread of its own.

    Attributes:
        target: what was typed.
        note: what the user should know; empty for nothing.
        frames: that were sent.
    """

    def __init__(self, target: str) -> None:
        self.target = target
        self.note = ""
        self.frames = 0
        self._overrun = 0
        self._missed = 0
        self._number = 0
        self._queue: queue.SimpleQueue[tuple[int, Solved] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=f"out {target}", daemon=True)

    def __call__(self, solved: Solved) -> None:
        """Takes a frame. In the thread that reconstructs."""
        self._number += 1
        if self._queue.qsize() < QUEUE_FRAMES:
            self._queue.put((self._number, solved))
        else:
            self._overrun += 1

    @property
    def missed(self) -> int:
        """Frames that a listener did not get because it, or this machine, was too slow; of several listeners
        the sum."""
        return self._overrun + self._missed

    def start(self) -> None:
        """Begins to send."""
        self._thread.start()

    def close(self) -> None:
        """Ends it; what waits is not sent any more. Harmless when closed before."""
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        self._begin()
        while item := self._queue.get():
            self._send(*item)
            self.frames += 1
        self._end()

    def _begin(self) -> None:  # noqa: B027
        """Says who the ribbons are, where listeners are known."""

    @abstractmethod
    def _send(self, number: int, solved: Solved) -> None:
        """Sends a frame; numbers count from 1, those missed included."""

    def _end(self) -> None:  # noqa: B027
        """Gives everything back."""
