"""Frames for other programs, as `--out` of `stream` and `replay` asks for."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

from ribbonhost.cli.output import Output, write_line
from ribbonhost.out import Facts, Feed, open_feed
from ribbonhost.pipeline.solving import OnSolved

LINES = "ndjson"
"""The target that shares stdout with what `--json` prints."""


class Outs:
    """The targets of a stream. `feeds`: to be given each frame."""

    def __init__(self, feeds: Sequence[Feed], on_event: Callable[[str, str], None]) -> None:
        self.feeds: Sequence[OnSolved] = feeds
        self._feeds = feeds
        self._on_event = on_event
        self._told = dict.fromkeys(feeds, 0)

    def watch(self) -> None:
        """Tells of listeners that miss frames: at the first, and whenever there are twice as many."""
        for feed in self._feeds:
            if feed.missed > 2 * self._told[feed]:
                self._told[feed] = feed.missed
                self._on_event(
                    f"out {feed.target}", f"{feed.missed} frames were missed so far: a listener is too slow"
                )


@contextmanager
def feeding(
    targets: Sequence[str], facts: Facts, output: Output, on_event: Callable[[str, str], None]
) -> Iterator[Outs]:
    """Sends frames to targets, and says in the end how many. Raises what `open_feed` does."""
    with ExitStack() as stack:
        feeds = []
        for target in targets:
            feeds.append(feed := open_feed(target, facts, write_line))
            stack.callback(feed.close)
            if feed.note:
                output.note(f"--out {target}: {feed.note}")
        for feed in feeds:
            feed.start()
        yield Outs(feeds, on_event)
        stack.close()
        for feed in feeds:
            output.fed(feed)
