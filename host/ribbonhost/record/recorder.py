"""Keeps what ribbons send, as it comes, without ever making the stream wait."""

import contextlib
import itertools
import json
import queue
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from ribbonhost import wire
from ribbonhost.errors import RecordingError, UsageError
from ribbonhost.record.file import RecordingFile
from ribbonhost.record.layout import COUNTING, KINDS, Header, RecordedRibbon, nanoseconds

QUEUE_ITEMS = 50_000
"""Messages that may wait for the disk, more than half a minute of six ribbons; further ones are given up."""

DRAIN_S = 0.1
FLUSH_S = 0.5
"""So much is lost at most when the program is killed, and the time that writing it takes."""

EXCHANGES_CARRIED = 128
"""Clock exchanges that a new part begins with: as many as the estimate of a clock rests on."""

RESERVE_BYTES = 1 << 20
"""With less room on the disk a recording ends by itself, while it can still be completed."""
WARN_S = 600.0
"""The disk is said to be nearly full when it has room for less than this."""

_ItemT = tuple[int, str, int, float, bytes]


class Tap:
    """The Observer of one device.

    Attributes:
        channel: its number in the recording.
        order: shared by all devices of a recording.
    """

    def __init__(
        self, channel: int, order: threading.Lock, put: Callable[[int, str, int, float, bytes], None]
    ) -> None:
        self.channel = channel
        self.order = order
        self._put = put
        self._numbers: dict[str, Iterator[int]] = {kind: itertools.count(1) for kind in KINDS}

    def received(self, packet: bytes, t_host_s: float) -> None:
        """See Observer."""
        self._tell("received", t_host_s, packet)

    def sent(self, packet: bytes, t_host_s: float) -> None:
        """See Observer."""
        self._tell("sent", t_host_s, packet)

    def spoiled(self, crc_errors: int, malformed: int, t_host_s: float) -> None:
        """See Observer."""
        counts = {"crc_errors": crc_errors, "malformed": malformed}
        self._tell("spoiled", t_host_s, json.dumps(counts).encode())

    def lost(self, why: str, t_host_s: float) -> None:
        """See Observer."""
        self._tell("lost", t_host_s, json.dumps({"why": why}).encode())

    def back(self, port: str, t_host_s: float) -> None:
        """See Observer."""
        self._tell("back", t_host_s, json.dumps({"port": port}).encode())

    def _tell(self, kind: str, t_host_s: float, data: bytes) -> None:
        self._put(self.channel, kind, next(self._numbers[kind]), t_host_s, data)


class Carried:
    """What a new part repeats of the parts before, so that it can be replayed alone."""

    def __init__(self) -> None:
        self._latest: dict[tuple[int, str, int], _ItemT] = {}
        self._exchanges: dict[int, deque[_ItemT]] = {}

    def see(self, item: _ItemT) -> None:
        ribbon, kind, _, _, data = item
        if kind == "back":
            self._latest.pop((ribbon, "lost", 0), None)
            self._exchanges.pop(ribbon, None)  # of a clock that started anew
        elif kind not in ("received", "sent"):
            self._latest[ribbon, kind, 0] = item
        elif data[0] in (wire.PacketId.CLOCK_PING, wire.PacketId.CLOCK_PONG):
            kept = self._exchanges.setdefault(ribbon, deque(maxlen=2 * EXCHANGES_CARRIED))
            kept.append(item)
        elif data[0] in (wire.PacketId.INFO, wire.PacketId.STATUS) or (
            data[0] == wire.PacketId.COMMAND and _is_get_info(data)
        ):
            self._latest[ribbon, kind, data[0]] = item

    def items(self) -> list[_ItemT]:
        """In the order in which a device must see them: who it is, then what its clock says."""
        order = {"sent": 0, "received": 1, "spoiled": 2, "lost": 4}
        latest = sorted(self._latest.values(), key=lambda item: (order[item[1]], item[0]))
        return latest + [item for kept in self._exchanges.values() for item in kept]


def _is_get_info(packet: bytes) -> bool:
    message, _ = wire.decode(packet)
    return isinstance(message, wire.Command) and message.command == wire.CommandCode.GET_INFO


class Recorder:
    """Writes a recording in a thread of its own.

    What the taps are told waits in memory until `start`. After an error, as on a full disk, the recording is
    closed, `ended` says why, `on_event` is told, and all further calls do nothing.

    Attributes:
        paths: the files written so far.
        ended: why the recording ended before it was closed; empty while it goes on.
        given_up: messages that did not fit into the queue.
        messages: written so far.
    """

    def __init__(
        self,
        path: Path,
        *,
        force: bool = False,
        rotate_bytes: int | None = None,
        rotate_s: float | None = None,
        on_event: Callable[[str, str], None] = lambda label, what: None,
    ) -> None:
        """With a rotation the files are named PATH-001.mcap and so on.

        Raises UsageError if a file of the name is there already and not to be replaced, or there is no such
        folder.
        """
        self.paths: list[Path] = []
        self.ended = ""
        self.given_up = 0
        self.messages = 0
        self._path = path
        self._force = force
        self._rotate_bytes = rotate_bytes
        self._rotate_s = rotate_s
        self._rotates = rotate_bytes is not None or rotate_s is not None
        self._on_event = on_event
        self._order = threading.Lock()
        self._taps: list[Tap] = []
        self._event_numbers = itertools.count(1)
        self._queue: queue.SimpleQueue[_ItemT] = queue.SimpleQueue()
        self._carried = Carried()
        self._ribbons: tuple[RecordedRibbon, ...] = ()
        self._file: RecordingFile | None = None
        self._t_zero_ns: int | None = None
        self._warned = False
        self._told_given_up = 0
        self._bytes_before = 0
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="record", daemon=True)
        self._check()

    def tap(self) -> Tap:
        """An observer for the next device."""
        self._taps.append(Tap(len(self._taps), self._order, self.keep))
        return self._taps[-1]

    def start(self, header: Header) -> None:
        """Begins to write. Raises RecordingError if the file cannot be written."""
        try:
            self._open(header)
        except OSError as error:
            raise RecordingError(f"{self._part_path(1)} cannot be written: {error.strerror}") from error
        self._t_start_s = self._t_part_s = time.monotonic()
        self._thread.start()

    def describe(self, ribbons: tuple[RecordedRibbon, ...]) -> None:
        """Keeps what is known of the ribbons by now, as when one joined."""
        self._ribbons = ribbons

    def event(self, label: str, what: str) -> None:
        """Keeps what happened to a ribbon."""
        self.keep(-1, label, next(self._event_numbers), time.monotonic(), what.encode())

    def count_from_here(self) -> None:
        """All ribbons deliver: time 0 of the recording."""
        self.event("recording", COUNTING)

    def close(self) -> None:
        """Writes what waits and completes the file. Harmless when never started or closed before."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    @property
    def bytes_written(self) -> int:
        """Of all parts so far."""
        file = self._file
        return self._bytes_before + (file.length if file else 0)

    def _check(self) -> None:
        there = [self._path] if self._path.exists() and not self._rotates else []
        if self._rotates:
            there = sorted(self._path.parent.glob(f"{self._path.stem}-[0-9]*{self._path.suffix}"))
        if there and not self._force:
            raise UsageError(f"{there[0]} is there already: give another name, or --force to replace it")
        if self._path.is_dir():
            raise UsageError(f"{self._path} is a folder: give the name of a file in it")
        if not self._path.parent.is_dir():
            raise UsageError(f"{self._path} cannot be written: there is no folder {self._path.parent}")

    def _part_path(self, part: int) -> Path:
        if not self._rotates:
            return self._path
        return self._path.with_name(f"{self._path.stem}-{part:03d}{self._path.suffix}")

    def _open(self, header: Header) -> RecordingFile:
        path = self._part_path(header.part)
        library = f"ribbonhost {header.host_version}"
        file = self._file = RecordingFile(path, header, library, replace=self._force)
        self.paths.append(path)
        return file

    def keep(self, ribbon: int, kind: str, number: int, t_host_s: float, data: bytes) -> None:
        """Takes a message of a channel, as the taps do; it is given up, and counted, if too many wait."""
        if self.ended:
            return
        if self._queue.qsize() < QUEUE_ITEMS:
            self._queue.put((ribbon, kind, number, t_host_s, data))
        else:
            self.given_up += 1

    def _run(self) -> None:
        flush_due_s = 0.0
        try:
            while not self._stopping.wait(DRAIN_S):
                self._drain()
                if (now_s := time.monotonic()) >= flush_due_s:
                    flush_due_s = now_s + FLUSH_S - DRAIN_S / 2
                    self._flush(now_s)
            self._drain()
            if self._file:
                self._file.finish()
        except (OSError, RecordingError) as error:
            self._end(getattr(error, "strerror", None) or str(error))

    def _drain(self) -> None:
        file = self._file
        assert file is not None
        ribbons = self._ribbons
        if ribbons and ribbons != file.header.ribbons:
            file.describe(replace(file.header, ribbons=ribbons))
        for _ in range(self._queue.qsize()):
            ribbon, kind, number, t_host_s, data = item = self._queue.get()
            t_ns = nanoseconds(t_host_s)
            if ribbon < 0:
                what = data.decode()
                if what == COUNTING:
                    self._t_zero_ns = t_ns
                file.write_event(number, t_ns, kind, what)
            else:
                self._carried.see(item)
                file.write(ribbon, kind, number, t_ns, data)
            self.messages += 1

    def _flush(self, now_s: float) -> None:
        file = self._file
        assert file is not None
        if self.given_up != self._told_given_up:
            lost, self._told_given_up = self.given_up - self._told_given_up, self.given_up
            what = f"the disk is too slow: {lost} messages were not recorded"
            self.event("recording", what)
            self._on_event("recording", what)
        file.flush()
        self._watch_disk(now_s)
        full = self._rotate_bytes is not None and file.length >= self._rotate_bytes
        late = self._rotate_s is not None and now_s - self._t_part_s >= self._rotate_s
        if full or late:
            self._rotate(file, now_s)

    def _watch_disk(self, now_s: float) -> None:
        free = free_bytes(self._path)
        if free < RESERVE_BYTES:
            raise RecordingError(f"the disk is full ({free >> 10} KiB are left)")
        rate = self.bytes_written / max(now_s - self._t_start_s, 10.0)
        if not self._warned and free < rate * WARN_S:
            self._warned = True
            self._on_event(
                "recording", f"the disk has room for {free / rate / 60:.0f} more minutes: make room on it"
            )

    def _rotate(self, file: RecordingFile, now_s: float) -> None:
        file.finish()
        self._bytes_before += file.length
        self._file, self._t_part_s = None, now_s
        opened = self._open(replace(file.header, part=file.header.part + 1, t_zero_ns=self._t_zero_ns))
        for ribbon, kind, _, t_host_s, data in self._carried.items():
            opened.write(ribbon, kind, 0, nanoseconds(t_host_s), data)

    def _end(self, why: str) -> None:
        self.ended = why
        kept = f"{self.paths[-1]} holds what was recorded until then" if self.paths else "nothing was kept"
        if self._file:
            with contextlib.suppress(OSError):
                self._file.finish()
        self._on_event("recording", f"ended: {why}; {kept}; the stream goes on")


def free_bytes(path: Path) -> int:
    """Room on the disk that a file is on."""
    return shutil.disk_usage(path.parent).free
