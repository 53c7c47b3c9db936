"""`ribbonhost stream`: opens the ribbons, runs the pipeline, and shows what comes until told to stop."""

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from ribbonhost.cli import forget_stdout
from ribbonhost.cli.emulation import Emulation, emulate
from ribbonhost.cli.opening import Opened, calibrations_of, rate_of
from ribbonhost.cli.options import StreamOptions
from ribbonhost.cli.output import JsonOutput, OnReport, Output, TableOutput
from ribbonhost.cli.outs import LINES, feeding
from ribbonhost.cli.viewing import TapeRecording, stream_page
from ribbonhost.comb import Comb, load_comb
from ribbonhost.errors import RibbonError, UsageError
from ribbonhost.link import ports_seen
from ribbonhost.out import Facts
from ribbonhost.pipeline.header import header_of, recorded_ribbons
from ribbonhost.pipeline.poses import MotionMode, is_mode
from ribbonhost.pipeline.solving import OnSolved
from ribbonhost.pipeline.stream import Stream
from ribbonhost.reconstruct.comb import METHODS, Method, is_method
from ribbonhost.record import Recorder, Tape

if TYPE_CHECKING:
    from ribbonhost.view import View

RIBBONS = 5


def run_stream(options: StreamOptions) -> None:
    """Streams until the time is up, Ctrl-C, no ribbon is left, or nobody reads what is printed.

    Raises RibbonError if it cannot begin or ended because nothing more can come.
    """
    comb, method, motion = _checked(options)
    output: Output = JsonOutput() if options.json or LINES in (options.out or ()) else TableOutput()
    try:
        _stream(options, comb, method, motion, output)
    except BrokenPipeError:
        forget_stdout()


def _stream(
    options: StreamOptions, comb: Comb | None, method: Method, motion: MotionMode, output: Output
) -> None:
    with ExitStack() as stack:
        stop = stack.enter_context(stop_on_signals())
        emulation: Emulation | None = None
        names: Sequence[str] = options.urls or ()
        if options.emulate is not None:
            emulation = stack.enter_context(
                emulate(
                    options.emulate,
                    ribbons=options.ribbons or RIBBONS,
                    seed=options.seed or 0,
                    part_errors=options.part_errors,
                    disturb=options.disturb or (),
                )
            )
            comb, names = emulation.comb, emulation.urls
        recorder: Recorder | None = None
        view: View | None = None

        def on_event(label: str, what: str) -> None:
            output.event(label, what)
            if view:
                view.event(label, what)
            if label != "recording":
                tape.event(label, what)

        if options.record:
            recorder = _recorder(options, options.record, on_event)
        tape = Tape(recorder)
        opened = Opened(names, options.baud, comb, output, tape)
        stack.callback(tape.end)
        stack.callback(opened.close)
        arrangement = opened.arrange(comb, awaits=options.reconnect)
        for note in arrangement.notes:
            output.note(note)
        for device in arrangement.unused:
            device.close()
        rate_hz = rate_of(options.rate_hz, arrangement.present, output)
        facts = Facts.of(arrangement, rate_hz=rate_hz, unix_offset_s=time.time() - time.monotonic())
        outs = stack.enter_context(feeding(options.out or (), facts, output, on_event))
        records = options.record is not None or options.view
        calibrations = calibrations_of(arrangement.present, motion, rate_hz, output, all_of_them=records)
        header = partial(
            header_of,
            arrangement,
            opened.channels,
            comb=comb,
            rate_hz=rate_hz,
            method=method,
            motion=motion,
            calibrations=calibrations,
        )
        consumers: list[OnSolved] = [*outs.feeds]
        show: list[OnReport] = [output.report, lambda report: outs.watch()]
        if options.view:
            button = TapeRecording(tape, header, on_event)
            truth = emulation is not None
            page = stream_page(arrangement, output.note, options.view_port, method, truth, button)
            view = stack.enter_context(page)
            consumers.append(view.on_solved)
            show.append(view.report)
        stream = Stream(
            arrangement,
            rate_hz=rate_hz,
            method=method,
            truth=emulation.truth_m if emulation else None,
            on_event=on_event,
            on_solved=consumers,
            reconnect=options.reconnect,
            motion=motion,
            calibrations=calibrations if records or motion != "off" else None,
            named=opened.absent,
            on_joined=lambda device: tape.describe(
                recorded_ribbons(arrangement, opened.channels, calibrations)
            ),
        )
        if recorder:
            recorder.start(header())
        _run(stream, options, stop, output, show, tape, on_event)
        tape.end()
        for recorder in tape.recorders:
            output.recorded(recorder)


def _run(
    stream: Stream,
    options: StreamOptions,
    stop: threading.Event,
    output: Output,
    show: Sequence[OnReport],
    tape: Tape,
    on_event: Callable[[str, str], None],
) -> None:
    with ExitStack() as stack:
        stack.callback(stream.close)
        stream.start(stop)
        if tape.recorder:
            tape.recorder.count_from_here()
        stack.enter_context(output)
        due_s = time.monotonic()
        end_s = due_s + options.seconds if options.seconds else float("inf")
        waits = False
        while True:
            due_s = min(due_s + output.interval_s, end_s)
            stop.wait(max(0.0, due_s - time.monotonic()))
            report = stream.report()
            for tell in show:
                tell(report)
            over = stream.over
            if stop.is_set() or time.monotonic() >= end_s or (over and not options.reconnect):
                break
            if over and not waits:
                on_event("stream", f"{over}: waiting until it is back; Ctrl-C ends it")
            waits = bool(over)
    output.summary(report)
    if over and not stop.is_set():
        raise RibbonError(over)


def _checked(options: StreamOptions) -> tuple[Comb | None, Method, MotionMode]:
    """The comb that the file describes, and how to reconstruct; the options are checked to go together."""
    if options.seconds is not None and not math.isfinite(options.seconds):
        raise UsageError(f"--seconds {options.seconds} is no duration")
    method = options.method
    if not is_method(method):
        raise UsageError(f"--method {method} is not one of {', '.join(METHODS)}")
    motion = options.motion
    if not is_mode(motion) or motion == "offline":
        raise UsageError(
            f"--motion {motion} is not off or live"
            + (": offline looks ahead, and is for replay, export and validate" if motion == "offline" else "")
        )
    for_recording = options.force or options.rotate_mib is not None or options.rotate_s is not None
    if options.record is None and for_recording:
        raise UsageError("--force, --rotate-mib and --rotate-s are for a recording: give --record FILE.mcap")
    if options.view_port is not None and not options.view:
        raise UsageError("--view-port is for a page: give --view")
    if options.emulate is not None:
        if options.urls or options.comb:
            raise UsageError("--emulate brings its own ribbons and comb: give it without ports and --comb")
        return None, method, motion
    for name, value in (
        ("--ribbons", options.ribbons),
        ("--seed", options.seed),
        ("--part-errors", options.part_errors),
        ("--disturb", options.disturb or None),
    ):
        if value is not None:
            raise UsageError(f"{name} is for --emulate only")
    if not options.urls:
        seen = ports_seen()
        raise UsageError(
            "no ribbon was named. "
            + (f"Serial ports here: {', '.join(seen)}. " if seen else "No serial port was found. ")
            + "Type `ribbonhost stream PORT` for a ribbon, name the others and --comb FILE for a surface, "
            "or `ribbonhost stream --emulate wing` for an emulated comb"
        )
    for url in options.urls:
        if options.urls.count(url) > 1:
            raise UsageError(f"{url} is given twice")
    return load_comb(options.comb) if options.comb else None, method, motion


def _recorder(options: StreamOptions, path: Path, on_event: Callable[[str, str], None]) -> Recorder:
    """Raises UsageError for a file that is there already or cannot be."""
    return Recorder(
        path,
        force=options.force,
        rotate_bytes=None if options.rotate_mib is None else round(options.rotate_mib * (1 << 20)),
        rotate_s=options.rotate_s,
        on_event=on_event,
    )


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C or a termination sets; a second Ctrl-C interrupts at once."""
    stop = threading.Event()

    def ask_to_stop(number: int, frame: FrameType | None) -> None:
        if stop.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, ask_to_stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
