"""Recordings through the code that reconstructs a stream: unchanged, they give the same frames to the bit."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

from ribbonhost.comb import parse_comb
from ribbonhost.device import RecordedDevice, Scan
from ribbonhost.errors import CombFileError, RecordingError
from ribbonhost.pipeline.arrangement import Arrangement, Place
from ribbonhost.pipeline.estimating import source_of
from ribbonhost.pipeline.poses import MODES, MotionMode, SourceOf, is_mode
from ribbonhost.pipeline.readings import NO_CALIBRATIONS, Calibrations, Ribbons
from ribbonhost.pipeline.reconstruction import Reconstruction
from ribbonhost.pipeline.report import Report
from ribbonhost.pipeline.smoothing import Progress, SmoothedPoses
from ribbonhost.pipeline.solving import OnSolved
from ribbonhost.reconstruct import CombLayout
from ribbonhost.reconstruct.comb import METHODS, Method, is_method
from ribbonhost.record import Back, Event, Header, Item, Lost, Received, Recording, Sent, Spoiled
from ribbonhost.record.layout import COUNTING
from ribbonhost.wire import WireError


class Replay:
    """Plays the parts of a recording, in order, in one thread.

    What took time in the stream (latencies) is measured in the times of the recording: a frame is done when
    the packet that completed it was read.

    Attributes:
        arrangement: the ribbons.
        t_s: where it is, seconds of the recording.
        t_zero_s: host time of second 0.
        method: of curves: that of the stream unless another was given.
        motion: where orientations come from, likewise.
        damaged: what made no sense and was left out.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        *,
        method: Method | None = None,
        motion: MotionMode | None = None,
        calibrations: Calibrations = NO_CALIBRATIONS,
        on_progress: Progress = lambda share: None,
        on_event: Callable[[str, str], None] = lambda label, what: None,
        on_solved: Iterable[OnSolved] = (),
    ) -> None:
        """`on_event` is told what happened in the stream, each of `on_solved` each frame.

        motion: as in the stream unless given; offline: all of the recording is estimated before the first
        frame, and `on_progress` told which share is. calibrations: by serial number, in place of those
        that were recorded; they change what motion is estimated from, not what `off` shows.
        Raises RecordingError if the files are not parts of one recording or describe no comb that can be.
        """
        header = recordings[-1].header  # of a ribbon that joined the later parts know more
        calibrations = recordings[-1].calibrations() | dict(calibrations)
        self.damaged = 0
        self.t_zero_s = recordings[0].t_zero_s
        self.t_s = 0.0
        self.method = method or _method(recordings[0])
        self.motion: MotionMode = motion or _motion(recordings[0])
        self._on_progress = on_progress
        self._smoothed: list[SmoothedPoses] = []
        self._prepared = False
        self._recordings = recordings
        self._on_event = on_event
        for recording in recordings[1:]:
            if not _same_ribbons(recording.header, header):
                raise RecordingError(f"{recording.path} is of other ribbons than {recordings[0].path}")
        self._devices = {
            ribbon.channel: RecordedDevice(ribbon.port)
            for ribbon in header.ribbons
            if ribbon.channel is not None
        }
        self.arrangement = self._arrangement(recordings[-1])
        # What it would say of silent ribbons was said in the stream, and recorded.
        self._reconstruction = Reconstruction(
            self.arrangement,
            rate_hz=header.rate_hz,
            method=self.method,
            on_solved=on_solved,
            source_of=self._smoothed_of(calibrations)
            if self.motion == "offline"
            else source_of(
                self.motion,
                self.arrangement,
                rate_hz=header.rate_hz,
                calibrations=calibrations,
                on_event=on_event,
            ),
            now_s=lambda: self.t_s + self.t_zero_s,
        )
        for index, place in enumerate(self.arrangement.places):
            if place.device:
                place.device.on_scan = lambda scan, index=index: self._reconstruction.take(index, scan)
                place.device.on_lost = lambda error, index=index: self._reconstruction.lose(index)

    def play(self) -> Iterator[float]:
        """Uses one recorded item after the other; yields where it is, seconds, after each.

        Time before 0 is what the stream needed until all ribbons delivered.
        """
        self.prepare()
        for number, recording in enumerate(self._recordings):
            for item in recording.items():
                if number and item.number == 0:
                    continue  # known from the part before
                t_s = item.t_host_s - self.t_zero_s
                self.t_s = t_s if self.t_s == 0.0 else max(self.t_s, t_s)
                try:
                    self._use(item)
                # Values that only a file written to mislead can hold: absurd times, other numbers of nodes.
                except (WireError, ArithmeticError, ValueError):
                    self.damaged += 1
                yield self.t_s
            self.damaged += recording.damaged

    def _smoothed_of(self, calibrations: Calibrations) -> SourceOf:
        rate_hz = self._recordings[0].header.rate_hz
        ribbons = Ribbons(self.arrangement, rate_hz, calibrations, self._on_event)

        def smoothed(places: Sequence[int]) -> SmoothedPoses:
            made = SmoothedPoses(ribbons, places)
            self._smoothed.append(made)
            return made

        return smoothed

    def prepare(self) -> None:
        """Estimates the whole recording, if that is asked for and not done: `play` would begin with it."""
        if not self._smoothed or self._prepared:
            return
        self._prepared = True
        first = Replay(self._recordings, method=self.method, motion="off")
        scans: list[list[Scan]] = [[] for _ in first.arrangement.places]
        for place, into in zip(first.arrangement.places, scans, strict=True):
            if place.device:
                place.device.on_scan = into.append
        for _ in first.play():
            pass
        for place, known in zip(self.arrangement.places, first.arrangement.places, strict=True):
            if place.device and known.device:
                place.device.info = known.device.info
        for number, smoothed in enumerate(self._smoothed):
            smoothed.smooth(scans, partial(self._tell_progress, number))

    def _tell_progress(self, number: int, share: float) -> None:
        self._on_progress((number + share) / len(self._smoothed))

    def start_counting(self) -> None:
        """Reports tell what happens from now on."""
        self._reconstruction.start_counting()

    def report(self) -> Report:
        """What happened since the count began; rates are over the time since the report before."""
        return self._reconstruction.report()

    def _use(self, item: Item) -> None:
        if isinstance(item, Event):
            if item.what == COUNTING:
                self.start_counting()
            else:
                self._on_event(item.label, item.what)
            return
        device = self._devices[item.ribbon]
        match item:
            case Received():
                device.receive(item.packet, item.t_host_s)
            case Sent():
                device.send_again(item.packet)
            case Spoiled():
                device.spoil(item.crc_errors, item.malformed)
            case Lost():
                device.lose(item.why, item.t_host_s)
            case Back():
                device.come_back(item.port, item.t_host_s)

    def _arrangement(self, recording: Recording) -> Arrangement:
        header = recording.header
        places = tuple(
            Place(
                ribbon.label,
                ribbon.serial,
                None if ribbon.channel is None else self._devices[ribbon.channel],
                ribbon.pitch_m,
                ribbon.node_count,
            )
            for ribbon in header.ribbons
        )
        if not header.comb:
            return Arrangement(tuple(place for place in places if place.device), None, (), ())
        try:
            comb = parse_comb(header.comb)
            layout = CombLayout(comb.pitch_m, places[0].node_count, tuple(r.start_m for r in comb.ribbons))
        except (CombFileError, ValueError) as error:
            raise RecordingError(f"{recording.path} describes no comb that can be: {error}") from error
        if [place.serial for place in places] != list(comb.serials):
            raise RecordingError(f"{recording.path} has other ribbons than its comb")
        return Arrangement(places, layout, (), ())


def _same_ribbons(header: Header, other: Header) -> bool:
    """Whether two parts may be of one recording; the serial number of one that is absent may be open."""
    pairs = zip(header.ribbons, other.ribbons, strict=False)
    return len(header.ribbons) == len(other.ribbons) and all(
        one.serial == two.serial or "" in (one.serial, two.serial) for one, two in pairs
    )


def _method(recording: Recording) -> Method:
    method = recording.header.method
    if not is_method(method):
        raise RecordingError(
            f"{recording.path} was reconstructed by the method {method!a}, which this ribbonhost "
            f"does not know: give one of {', '.join(METHODS)} with --method"
        )
    return method


def _motion(recording: Recording) -> MotionMode:
    motion = recording.header.motion
    if not is_mode(motion):
        raise RecordingError(
            f"{recording.path} was reconstructed with --motion {motion!a}, which this ribbonhost does not "
            f"know: give one of {', '.join(MODES)} with --motion"
        )
    return motion
