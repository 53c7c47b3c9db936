"""`ribbonhost replay`: shows a recording as the stream was shown."""

import threading
import time
from collections.abc import Sequence
from pathlib import Path

from ribbonhost.cli.output import JsonOutput, Output, TableOutput
from ribbonhost.cli.outs import LINES, feeding
from ribbonhost.cli.progress import progress_bar
from ribbonhost.cli.recording_options import ReplayOptions
from ribbonhost.cli.recover import offer_recovery
from ribbonhost.cli.stream import stop_on_signals
from ribbonhost.cli.viewing import replay_page
from ribbonhost.errors import UsageError
from ribbonhost.out import Facts
from ribbonhost.pipeline.poses import MODES, MotionMode, is_mode
from ribbonhost.pipeline.readings import NO_CALIBRATIONS, Calibrations
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.solving import OnSolved, Solved
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


def checked_motion(motion: str | None) -> MotionMode | None:
    """Raises UsageError for a way of estimating motion that there is not."""
    if motion is not None and not is_mode(motion):
        raise UsageError(f"--motion {motion} is not one of {', '.join(MODES)}")
    return motion


def later_calibrations(
    paths: Sequence[Path], recording: Recording, motion: MotionMode | None
) -> Calibrations:
    """The calibrations of `--calibration` files, by serial number.

    Raises UsageError for files that are none of this recording's, and where they would have no effect.
    """
    if not paths:
        return NO_CALIBRATIONS
    from ribbonhost.cli.calibration_file import load_calibrations

    if (motion or recording.header.motion) == "off":
        raise UsageError(
            "--calibration calibrates readings anew, and --motion off shows orientations that the ribbon "
            "made of them: give --motion live or offline"
        )
    return load_calibrations(paths, recording.header)


def run_replay(paths: Sequence[Path], options: ReplayOptions) -> None:
    """Plays until the end or Ctrl-C; with a page until Ctrl-C.

    Raises RecordingError, UsageError if there is nothing from `from_s` on.
    """
    chosen, out = checked_method(options.method), options.out or ()
    output: Output = JsonOutput() if options.json or LINES in out else TableOutput()
    if options.view_port is not None and not options.view:
        raise UsageError("--view-port is for a page: give --view")
    if options.view and options.out:
        raise UsageError("--view plays in its page, --out as the recording goes: give one of them")
    if options.view:
        _view(paths, options, chosen, output)
        return
    recordings = open_recordings(paths)
    motion = checked_motion(options.motion)
    feeds: list[OnSolved] = []

    def on_solved(solved: Solved) -> None:
        if replay.t_s >= options.from_s:
            for feed in feeds:
                feed(solved)

    with progress_bar("estimate") as progress:
        replay = Replay(
            recordings,
            method=chosen,
            motion=motion,
            calibrations=later_calibrations(options.calibration or (), recordings[-1], motion),
            on_event=output.event,
            on_progress=progress,
            on_solved=[on_solved],
        )
        replay.prepare()
    header = recordings[0].header
    facts = Facts.of(replay.arrangement, rate_hz=header.rate_hz, unix_offset_s=header.wall_offset_ns / 1e9)
    with stop_on_signals() as stop, feeding(out, facts, output, output.event) as outs, output:
        feeds.extend(outs.feeds)
        _play(replay, options.speed, options.from_s, output, stop)
    _sum_up(replay, output)


def _sum_up(replay: Replay, output: Output) -> None:
    output.summary(replay.report())
    if replay.damaged:
        output.note(f"{replay.damaged} damaged pieces of the recording were left out")


def _view(paths: Sequence[Path], options: ReplayOptions, method: Method | None, output: Output) -> None:
    """Reads the whole recording into the page, in which it is played and scrubbed."""
    if not options.speed:
        raise UsageError("--speed 0 shows nothing: give --view a speed above 0")

    def on_solved(solved: Solved) -> None:
        t_s = solved.match.t_host_s - replay.t_zero_s
        if t_s >= 0:
            view.keep(solved, t_s)

    recordings = open_recordings(paths)
    motion = checked_motion(options.motion)
    replay = Replay(
        recordings,
        method=method,
        motion=motion,
        calibrations=later_calibrations(options.calibration or (), recordings[-1], motion),
        on_event=output.event,
        on_solved=[on_solved],
    )
    page = replay_page(
        replay.arrangement,
        recordings[0].header,
        output.note,
        options.view_port,
        replay.method,
        start_s=options.from_s,
        speed=options.speed,
    )
    with stop_on_signals() as stop, page as view:
        due_s = 0.0
        for t_s in replay.play():
            if stop.is_set():
                break
            if t_s >= due_s:
                due_s = t_s + output.interval_s
                view.report(replay.report())
        if replay.t_s < options.from_s:
            raise UsageError(f"--from {options.from_s:g}: the recording ends at {replay.t_s:.1f} s")
        view.report(replay.report())
        _sum_up(replay, output)
        stop.wait()


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
