"""Work that threads share with the one that asks for it."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait


class Helpers:
    """Threads that help with pieces of a fraction of a millisecond, for which a queue would take too long."""

    def __init__(self, count: int) -> None:
        """count: of the threads; with none the caller does all."""
        self._count = count
        self._pool = ThreadPoolExecutor(max(1, count), "motion")

    def share(self, work: Callable[[int], None], count: int) -> None:
        """Calls work(0) ... work(count - 1), the pieces dealt out beforehand.

        Raises what a piece raises, after the other threads are done with theirs.
        """
        parts = min(self._count + 1, count)

        def part(first: int) -> None:
            for piece in range(first, count, parts):
                work(piece)

        others = [self._pool.submit(part, first) for first in range(1, parts)]
        try:
            part(0)
        finally:
            wait(others)
        for other in others:
            other.result()
