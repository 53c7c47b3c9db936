"""Reads recordings, whole, torn or damaged: gives what is intact and says what is not."""

import io
import json
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from ribbonhost import wire
from ribbonhost.errors import RecordingError
from ribbonhost.record.layout import COUNTING, EVENTS, HEADER, KINDS, NS, Header, topic

RECORD_BYTES_MAX = 64 << 20
"""No record of a recording is longer; a length beyond is damage."""

_RECORD = struct.Struct("<BQ")
_FOOTER_BYTES = 20
_END_BYTES = _RECORD.size + _FOOTER_BYTES + len(MCAP0_MAGIC)
_KEPT: dict[int, type[Channel] | type[Schema] | type[Metadata]] = {
    Opcode.CHANNEL: Channel,
    Opcode.SCHEMA: Schema,
    Opcode.METADATA: Metadata,
}
_BAD = (McapError, struct.error, ValueError, OverflowError)


@dataclass(frozen=True)
class Item:
    """Something that was recorded.

    Attributes:
        ribbon: channel number; -1 for an event of none.
        number: counts the messages of its kind and ribbon from 1; 0: repeated from the part before.
        t_host_s: when, on the host's clock.
    """

    ribbon: int
    number: int
    t_host_s: float


@dataclass(frozen=True)
class Received(Item):
    """An intact packet, type byte and fields."""

    packet: bytes


@dataclass(frozen=True)
class Sent(Item):
    """A packet of the host."""

    packet: bytes


@dataclass(frozen=True)
class Spoiled(Item):
    """Frames so far that were no packets."""

    crc_errors: int
    malformed: int


@dataclass(frozen=True)
class Lost(Item):
    """The link is gone."""

    why: str


@dataclass(frozen=True)
class Back(Item):
    """There is a new link, on this port."""

    port: str


@dataclass(frozen=True)
class Event(Item):
    """What happened to a ribbon."""

    label: str
    what: str


def is_complete(path: Path) -> bool:
    """Whether the file ends as one that was closed.

    Raises RecordingError if it cannot be read or is no MCAP file.
    """
    with _opened(path) as file:
        if not MCAP0_MAGIC.startswith(file.read(len(MCAP0_MAGIC))):
            raise RecordingError(f"{path} is no recording: it is not an MCAP file")
        size = os.fstat(file.fileno()).st_size
        if size < _END_BYTES:
            return False
        file.seek(size - _END_BYTES)
        end = file.read()
    return end[: _RECORD.size] == _RECORD.pack(Opcode.FOOTER, _FOOTER_BYTES) and end.endswith(MCAP0_MAGIC)


class RecordReader:
    """The MCAP records of a file that hold something: channels, schemas, metadata, messages, in order.

    Attributes:
        damaged: chunks and records that were left out because their contents cannot be.
        share: how much of the file has been read, 0 to 1.
    """

    def __init__(self, path: Path, *, chunks: bool = True) -> None:
        """chunks: whether to read what is in chunks: messages and their channels."""
        self.damaged = 0
        self.share = 0.0
        self._path = path
        self._chunks = chunks

    def __iter__(self) -> Iterator[McapRecord]:
        """Ends where the file does, or where it makes no sense any more. Raises RecordingError for a file
        that cannot be read or is no MCAP file."""
        self.damaged = 0
        with _opened(self._path) as file:
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise RecordingError(f"{self._path} is no recording: it is not an MCAP file")
            size = os.fstat(file.fileno()).st_size
            while len(head := file.read(_RECORD.size)) == _RECORD.size:
                self.share = min(1.0, file.tell() / size)
                opcode, length = _RECORD.unpack(head)
                if length > RECORD_BYTES_MAX or opcode in (0, Opcode.DATA_END, Opcode.FOOTER):
                    self.damaged += opcode not in (Opcode.DATA_END, Opcode.FOOTER)
                    return
                if opcode == Opcode.CHUNK and not self._chunks:
                    file.seek(length, os.SEEK_CUR)
                    continue
                content = file.read(length)
                if len(content) < length:
                    return
                if opcode == Opcode.CHUNK:
                    yield from self._chunk(content)
                else:
                    yield from self._record(opcode, content)

    def _chunk(self, content: bytes) -> Iterator[McapRecord]:
        try:
            chunk = Chunk.read(ReadDataStream(io.BytesIO(content)))
        except _BAD:
            self.damaged += 1
            return
        if chunk.compression:
            raise RecordingError(
                f"{self._path} was compressed ({chunk.compression!a}) by another program: decompress it first"
            )
        if chunk.uncompressed_crc and zlib.crc32(chunk.data) != chunk.uncompressed_crc:
            self.damaged += 1
            return
        at = 0
        while at + _RECORD.size <= len(chunk.data):
            opcode, length = _RECORD.unpack_from(chunk.data, at)
            at += _RECORD.size
            if at + length > len(chunk.data):
                self.damaged += 1
                return
            yield from self._record(opcode, chunk.data[at : at + length])
            at += length

    def _record(self, opcode: int, content: bytes) -> Iterator[McapRecord]:
        stream = ReadDataStream(io.BytesIO(content))
        try:
            if opcode == Opcode.MESSAGE:
                yield Message.read(stream, len(content))
            elif kind := _KEPT.get(opcode):
                yield kind.read(stream)
        except _BAD:
            self.damaged += 1


class Recording:
    """A file that was recorded.

    Attributes:
        path: where it is.
        header: what it says of itself.
        t_zero_s: host time of its time 0: when the stream began to count, else when its first message came.
        damaged: after reading `items`: what was left out because its contents cannot be.
        share: while reading `items`: how much of the file has been read, 0 to 1.
    """

    def __init__(self, path: Path) -> None:
        """Raises RecordingError for a file that cannot be read or is no recording."""
        self.path = path
        self.damaged = 0
        self.share = 0.0
        self.header = self._read_header()
        self.t_zero_s = self._find_zero()

    def items(self) -> Iterator[Item]:
        """All that was recorded, in the order in which the host used it."""
        meanings = {(topic(r.channel, kind)): (r.channel, kind) for r in self.header.ribbons
                    if r.channel is not None for kind in KINDS}  # fmt: skip
        meanings[EVENTS] = (-1, "event")
        channels: dict[int, tuple[int, str]] = {}
        reader = RecordReader(self.path)
        bad = 0
        for record in reader:
            self.share = reader.share
            if isinstance(record, Channel) and record.topic in meanings:
                channels[record.id] = meanings[record.topic]
            elif isinstance(record, Message) and record.channel_id in channels:
                try:
                    yield _item(*channels[record.channel_id], record, self.header.log_offset_ns)
                except (KeyError, TypeError, ValueError, RecursionError):
                    bad += 1
            self.damaged = reader.damaged + bad

    def calibrations(self) -> dict[str, wire.Calibration]:
        """The calibrations that the ribbons used, by serial number, of those for which it was recorded.

        Raises RecordingError for one that is damaged.
        """
        try:
            return {
                ribbon.serial: wire.Calibration.unpack(ribbon.calibration_record)
                for ribbon in self.header.ribbons
                if ribbon.calibration_record
            }
        except wire.WireError as error:
            raise RecordingError(f"{self.path} holds a damaged calibration: {error}") from error

    def _read_header(self) -> Header:
        """The latest: what follows the first is only looked for where a ribbon may have joined."""
        header: Header | None = None
        for record in RecordReader(self.path, chunks=False):
            if isinstance(record, Metadata) and record.name == HEADER:
                try:
                    header = Header.from_metadata(record.metadata)
                except RecordingError as error:
                    raise RecordingError(f"{self.path} {error}") from error
                if not any(ribbon.is_absent for ribbon in header.ribbons):
                    break
        if header is None:
            raise RecordingError(f"{self.path} is an MCAP file, but not a recording of ribbonhost")
        return header

    def _find_zero(self) -> float:
        if self.header.t_zero_ns is not None:
            return self.header.t_zero_ns / NS
        first_s: float | None = None
        for item in self.items():
            first_s = item.t_host_s if first_s is None else first_s
            if isinstance(item, Event) and item.what == COUNTING:
                return item.t_host_s
        return first_s or 0.0


def _item(ribbon: int, kind: str, message: Message, log_offset_ns: int) -> Item:
    number, t_s, data = message.sequence, (message.log_time - log_offset_ns) / NS, message.data
    match kind:
        case "received":
            return Received(ribbon, number, t_s, data)
        case "sent":
            return Sent(ribbon, number, t_s, data)
    values = json.loads(data)
    match kind:
        case "spoiled":
            return Spoiled(ribbon, number, t_s, int(values["crc_errors"]), int(values["malformed"]))
        case "lost":
            return Lost(ribbon, number, t_s, str(values["why"]))
        case "back":
            return Back(ribbon, number, t_s, str(values["port"]))
        case _:
            return Event(ribbon, number, t_s, str(values["ribbon"]), str(values["what"]))


def _opened(path: Path) -> IO[bytes]:
    try:
        return path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from error
