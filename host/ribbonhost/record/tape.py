"""The traffic of all devices of a stream, recorded while somebody wants it."""

import threading

from ribbonhost.record.layout import Header, RecordedRibbon
from ribbonhost.record.recorder import Carried, Recorder, Tap


class Tape:
    """Hears all devices from the beginning, so that a recording can begin and end at any time.

    Attributes:
        recorder: of the recording that runs; None while there is none.
        recorders: of all recordings so far.
    """

    def __init__(self, recorder: Recorder | None = None) -> None:
        """`recorder`, which the caller starts, records from the beginning."""
        self.recorder = recorder
        self.recorders = [recorder] if recorder else []
        self._order = threading.Lock()
        self._gate = threading.Lock()
        self._channels = 0
        self._carried = Carried()
        self._numbers: dict[tuple[int, str], int] = {}
        self._before: dict[tuple[int, str], int] = {}

    def tap(self) -> Tap:
        """An observer for the next device."""
        self._channels += 1
        return Tap(self._channels - 1, self._order, self._hear)

    def begin(self, recorder: Recorder, header: Header) -> None:
        """Records from now on, which is time 0; what must be known of the time before comes first.

        Raises RecordingError if the file cannot be written.
        """
        with self._gate:
            for ribbon, kind, _, t_host_s, data in self._carried.items():
                recorder.keep(ribbon, kind, 0, t_host_s, data)
            self._before = dict(self._numbers)
            self.recorder = recorder
        try:
            recorder.start(header)
        except BaseException:
            self.recorder = None
            raise
        recorder.count_from_here()
        self.recorders.append(recorder)

    def end(self) -> None:
        """Completes the recording if one runs."""
        with self._gate:
            recorder, self.recorder = self.recorder, None
        if recorder:
            recorder.close()

    def describe(self, ribbons: tuple[RecordedRibbon, ...]) -> None:
        """Keeps what is known of the ribbons by now, as when one joined."""
        if recorder := self.recorder:
            recorder.describe(ribbons)

    def event(self, label: str, what: str) -> None:
        """Keeps what happened to a ribbon."""
        if recorder := self.recorder:
            recorder.event(label, what)

    def _hear(self, channel: int, kind: str, number: int, t_host_s: float, data: bytes) -> None:
        with self._gate:
            self._carried.see((channel, kind, number, t_host_s, data))
            self._numbers[channel, kind] = number
            if self.recorder:
                number -= self._before.get((channel, kind), 0)
                self.recorder.keep(channel, kind, number, t_host_s, data)
