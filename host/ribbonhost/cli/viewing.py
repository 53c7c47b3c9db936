"""The page of `--view`: of a stream, with its record button, or of a recording."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ribbonhost.device import Device
from ribbonhost.errors import MissingExtraError, RibbonError
from ribbonhost.pipeline.arrangement import Arrangement
from ribbonhost.reconstruct.comb import Method
from ribbonhost.record import Header, Recorder, Tape

if TYPE_CHECKING:
    from ribbonhost.view import View

DAY_S = 86_400


class TapeRecording:
    """The record button of a stream: a press begins a file in the working folder, the next ends it."""

    def __init__(
        self, tape: Tape, header: Callable[[], Header], on_event: Callable[[str, str], None]
    ) -> None:
        self._tape = tape
        self._header = header
        self._on_event = on_event
        self._begun_s = time.monotonic()

    @property
    def is_running(self) -> bool:
        """Whether something is recorded now."""
        recorder = self._tape.recorder
        return recorder is not None and not recorder.ended

    def begin(self) -> None:
        """Raises RibbonError if no file can be written here."""
        self._tape.end()
        path = Path(f"ribbon-{time.strftime('%Y%m%d-%H%M%S')}.mcap").resolve()
        self._tape.begin(Recorder(path, on_event=self._on_event), self._header())
        self._begun_s = time.monotonic()

    def end(self) -> None:
        """Completes the file."""
        self._tape.end()

    def status(self) -> str:
        """What is or was recorded."""
        if not self._tape.recorders:
            return ""
        recorder = self._tape.recorders[-1]
        where = recorder.paths[-1] if recorder.paths else "nothing yet"
        size = f"{recorder.bytes_written / (1 << 20):.1f} MiB"
        if recorder.ended:
            return f"{where}: ended, {recorder.ended}"
        if self.is_running:
            return f"{where}: {time.monotonic() - self._begun_s:.0f} s, {size}"
        return f"{where}: complete, {size}"


def stream_page(
    arrangement: Arrangement,
    tell: Callable[[str], None],
    port: int | None,
    method: Method,
    truth: bool,
    recording: TapeRecording,
) -> AbstractContextManager["View"]:
    """The page of a stream. truth: whether it is known where the nodes truly are."""
    calibrated = [
        _calibrated(place.device) if place.device and place.device.info else ""
        for place in arrangement.places
    ]
    return _serving(
        tell,
        lambda view: view(
            arrangement, method=method, truth=truth, port=port, recording=recording, calibrated=calibrated
        ),
    )


def replay_page(
    arrangement: Arrangement,
    header: Header,
    tell: Callable[[str], None],
    port: int | None,
    method: Method,
    *,
    start_s: float,
    speed: float,
) -> AbstractContextManager["View"]:
    """The page of a recording, which plays from start_s on."""
    numbers = {ribbon.serial: ribbon.calibration[0] for ribbon in header.ribbons}
    calibrated = [_numbered(numbers[place.serial]) for place in arrangement.places]
    return _serving(
        tell,
        lambda view: view(
            arrangement,
            method=method,
            live=False,
            port=port,
            calibrated=calibrated,
            start_s=start_s,
            speed=speed,
        ),
    )


@contextmanager
def _serving(tell: Callable[[str], None], make: Callable[[type["View"]], "View"]) -> Iterator["View"]:
    """Serves a page, says where, and opens it where there is a display.

    Raises MissingExtraError where viser is not installed, UsageError if the port is taken.
    """
    try:
        from ribbonhost.view import View, has_display, open_browser
    except ImportError as error:
        raise MissingExtraError("--view", "viser", "view") from error
    view = make(View)
    begun_s = time.monotonic()
    try:
        tell(f"view: {view.url}")
        if has_display():
            open_browser(view.url)
        yield view
        if view.moments:
            busy = 100 * view.busy_s / (time.monotonic() - begun_s)
            tell(f"view: {view.moments} pictures, {busy:.1f} % of a core")
    finally:
        view.close()


def _calibrated(device: Device) -> str:
    """How old a ribbon's calibration is, if it says so."""
    from ribbonhost.device.calibration import read_calibration

    number = device.info.calibration_sequence if device.info else 0
    try:
        created_s = read_calibration(device).values.created_s if number else 0
    except RibbonError:
        created_s = 0
    return f"{(time.time() - created_s) / DAY_S:.0f} days ago" if created_s else _numbered(number)


def _numbered(number: int) -> str:
    return f"no. {number}" if number else "never"
