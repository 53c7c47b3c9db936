"""JSON lines on stdout."""

from collections.abc import Callable

from ribbonhost.out import message
from ribbonhost.out.feed import Feed
from ribbonhost.pipeline.solving import Solved


class LineFeed(Feed):
    """Prints. A reader that left ends it quietly; the command notices by itself."""

    def __init__(self, facts: message.Facts, write_line: Callable[[str], None]) -> None:
        super().__init__("ndjson")
        self._facts = facts
        self._write_line = write_line
        self._broken = False

    def _begin(self) -> None:
        self._write(message.hello(self._facts))

    def _send(self, number: int, solved: Solved) -> None:
        if not self._broken:
            self._write(message.frame(number, solved))

    def _write(self, line: str) -> None:
        try:
            self._write_line(line)
        except (BrokenPipeError, ValueError):
            self._broken = True
