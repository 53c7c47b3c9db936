"""What `ribbonhost stream` prints: a live table for people, or JSON lines for programs."""

import json
import queue
import sys
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Protocol

from rich.console import Console
from rich.live import Live

from ribbonhost.cli.table import summary_of, table_of
from ribbonhost.out import Feed
from ribbonhost.pipeline.report import JsonObject, Report
from ribbonhost.record import Recorder

OnReport = Callable[[Report], None]
"""Who is told how a stream stands."""

_stdout_lock = threading.Lock()


def write_line(line: str) -> None:
    """Prints a line whole, whoever else prints; it is there at once. Raises BrokenPipeError."""
    with _stdout_lock:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


class _Console(Console):
    """Leaves it to the caller what to do when nobody reads any more."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


class Output(Protocol):
    """Where a stream shows what it does. `with` encloses the time in which it runs.

    `event` may be called in any thread, the others in one.
    """

    interval_s: float

    def __enter__(self) -> "Output": ...

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def note(self, text: str) -> None:
        """Something the user should know before the stream runs."""

    def event(self, label: str, what: str) -> None:
        """Something that happened to a ribbon."""

    def report(self, report: Report) -> None:
        """How it stands; comes every `interval_s`."""

    def summary(self, report: Report) -> None:
        """How it was, at the end."""

    def recorded(self, recorder: Recorder) -> None:
        """What was recorded, after the end."""

    def fed(self, feed: Feed) -> None:
        """What was sent to others, after the end."""


class JsonOutput:
    """One JSON object a line on stdout."""

    interval_s = 1.0

    def __init__(self) -> None:
        self._events: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()

    def __enter__(self) -> "JsonOutput":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._print_events()

    def note(self, text: str) -> None:
        self._print({"note": text})

    def event(self, label: str, what: str) -> None:
        self._events.put((label, what))

    def report(self, report: Report) -> None:
        self._print_events()
        self._print(report.as_json())

    def summary(self, report: Report) -> None:
        self._print_events()
        self._print(report.summary_as_json())

    def recorded(self, recorder: Recorder) -> None:
        self._print(
            {
                "recording": {
                    "files": [str(path) for path in recorder.paths],
                    "bytes": recorder.bytes_written,
                    "messages": recorder.messages,
                    "given_up": recorder.given_up,
                    "ended": recorder.ended or None,
                }
            }
        )

    def fed(self, feed: Feed) -> None:
        self._print({"out": {"target": feed.target, "frames": feed.frames, "missed": feed.missed}})

    def _print_events(self) -> None:
        while not self._events.empty():
            label, what = self._events.get()
            self._print({"event": {"ribbon": label, "what": what}})

    def _print(self, value: JsonObject) -> None:
        write_line(json.dumps(value, allow_nan=False))


class TableOutput:
    """A table that is drawn anew on a terminal, and printed once, at the end, elsewhere."""

    interval_s = 1.0

    def __init__(self) -> None:
        self._console = _Console()
        self._messages = Console(stderr=True, highlight=False, soft_wrap=True)
        self._live: Live | None = None

    def __enter__(self) -> "TableOutput":
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live:
            self._live.stop()
            self._live = None

    def note(self, text: str) -> None:
        self._messages.print(text, markup=False)

    def event(self, label: str, what: str) -> None:
        # On a terminal the live table must know of lines above it; rich locks its console.
        console = self._console if self._live else self._messages
        console.print(f"{label}: {what}", markup=False)

    def report(self, report: Report) -> None:
        if self._live:
            self._live.update(table_of(report), refresh=True)

    def summary(self, report: Report) -> None:
        if not self._console.is_terminal:
            self._console.print(table_of(report))
        self._console.print(summary_of(report), markup=False, soft_wrap=True, highlight=False)

    def recorded(self, recorder: Recorder) -> None:
        files = ", ".join(str(path) for path in recorder.paths)
        text = f"{files}: {recorder.messages} messages, {recorder.bytes_written / (1 << 20):.1f} MiB"
        if recorder.given_up:
            text += f", {recorder.given_up} given up"
        if recorder.ended:
            text += f"; ended early: {recorder.ended}"
        self._console.print(text + ".", markup=False, soft_wrap=True, highlight=False)

    def fed(self, feed: Feed) -> None:
        self.note(f"{feed.target}: {feed.frames} frames sent, {feed.missed} missed by slow listeners.")
