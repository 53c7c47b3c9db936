"""`ribbonhost replay`: shows a recording as the stream was shown."""

import threading
import time
from collections.abc import Sequence
from pathlib import Path

from ribbonhost.cli.output import JsonOutput, Output, TableOutput
from ribbonhost.cli.recover import offer_recovery
from ribbonhost.cli.stream import stop_on_signals
from ribbonhost.errors import UsageError
from ribbonhost.pipeline.replay import Replay
from ribbonhost.reconstruct.comb import METHODS, Method, is_method
from ribbonhost.record import Recording

AHEAD_S = 0.01


def open_recordings(paths: Sequence[Path]) -> list[Recording]:
    """The files of one recording. Raises RecordingError; a torn one can be made whole where asked."""
    for path in paths:
        offer_recovery(path)
    return sorted((Recording(path) for path in paths), key=lambda recording: recording.header.part)


def checked_method(method: str | None) -> Method | None:
    """Raises UsageError for a method that there is not."""
    if method is not None and not is_method(method):
        raise UsageError(f"--method {method} is not one of {', '.join(METHODS)}")
    return method


def run_replay(
    paths: Sequence[Path], *, speed: float, from_s: float, method: str | None, as_json: bool
) -> None:
    """Plays until the end or Ctrl-C. speed: times real time, 0: as fast as possible.

    Raises RecordingError, UsageError if there is nothing from `from_s` on.
    """
    chosen = checked_method(method)
    output: Output = JsonOutput() if as_json else TableOutput()
    replay = Replay(open_recordings(paths), method=chosen, on_event=output.event)
    with stop_on_signals() as stop, output:
        _play(replay, speed, from_s, output, stop)
    output.summary(replay.report())
    if replay.damaged:
        output.note(f"{replay.damaged} damaged pieces of the recording were left out")


def _play(replay: Replay, speed: float, from_s: float, output: Output, stop: threading.Event) -> None:
    begun_s: float | None = None
    due_s = from_s + output.interval_s
    for t_s in replay.play():
        if t_s < from_s:
            continue
        if begun_s is None:
            begun_s = time.monotonic()
            replay.start_counting()
        if speed and (ahead_s := (t_s - from_s) / speed - (time.monotonic() - begun_s)) > AHEAD_S:
            stop.wait(ahead_s)
        if stop.is_set():
            break
        if t_s >= due_s:
            due_s += output.interval_s
            output.report(replay.report())
    if begun_s is None:
        raise UsageError(f"--from {from_s:g}: the recording ends at {replay.t_s:.1f} s")
