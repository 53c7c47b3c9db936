"""One MCAP file while it is written: on the disk it is always whole up to the last flush."""

import contextlib
import json
import os
from pathlib import Path
from typing import IO, Any, cast

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import MCAP0_MAGIC, CompressionType, IndexType, Writer

from ribbonhost.record.layout import EVENTS, HEADER, KINDS, PROFILE, Header, topic

CHUNK_BYTES = 256 * 1024


class _Disk:
    """What an MCAP writer writes to: kept in memory until flush, then written whole or not at all."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._waiting = bytearray()
        self._written = 0

    def write(self, data: bytes) -> int:
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        return self._written + len(self._waiting)

    def flush(self) -> None:
        """Raises OSError, with the file as it was at the flush before."""
        waiting = memoryview(bytes(self._waiting))
        self._waiting.clear()
        done = 0
        try:
            while done < len(waiting):
                done += os.write(self.descriptor, waiting[done:])
        except OSError:
            os.ftruncate(self.descriptor, self._written)
            os.lseek(self.descriptor, self._written, os.SEEK_SET)
            raise
        self._written += done


class RecordingFile:
    """Writes one file. For one thread.

    Attributes:
        path: where it is.
        header: what it says of itself.
    """

    def __init__(self, path: Path, header: Header, library: str, *, replace: bool) -> None:
        """Raises FileExistsError for a file that is there and not to be replaced, OSError if it cannot be
        written."""
        self.path = path
        self.header = header
        self._closed = False
        flags = os.O_WRONLY | os.O_CREAT | (os.O_TRUNC if replace else os.O_EXCL)
        self._disk = _Disk(os.open(path, flags | getattr(os, "O_BINARY", 0), 0o666))
        # Message indices would grow in memory with the recording; readers do without them.
        writer: Any = Writer(
            cast(IO[bytes], self._disk),
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.NONE,
            index_types=IndexType.CHUNK | IndexType.METADATA,
        )
        self._writer = writer
        try:
            self._writer.start(profile=PROFILE, library=library)
            self._writer.add_metadata(HEADER, header.to_metadata())
            self._events = self._writer.register_channel(EVENTS, "json", 0)
            self._channels = {
                (ribbon.channel, kind): self._writer.register_channel(
                    topic(ribbon.channel, kind),
                    "ribbon-wire" if kind in ("received", "sent") else "json",
                    0,
                    {
                        "serial": ribbon.serial,
                        "label": ribbon.label,
                        "schema_hash": f"{header.schema_hash:08x}",
                    },
                )
                for ribbon in header.ribbons
                if ribbon.channel is not None
                for kind in KINDS
            }
            self._writer.flush()
        except OSError:
            os.close(self._disk.descriptor)
            os.unlink(path)
            raise

    def describe(self, header: Header) -> None:
        """Says anew what the recording is; its channels stay as they are."""
        self.header = header
        self._writer.add_metadata(HEADER, header.to_metadata())

    @property
    def length(self) -> int:
        """Bytes so far."""
        return self._disk.tell()

    def write(self, ribbon: int, kind: str, number: int, t_ns: int, data: bytes) -> None:
        """Adds a message of a ribbon; of one that is not in the header nothing."""
        if channel := self._channels.get((ribbon, kind)):
            self._writer.add_message(channel, t_ns, data, t_ns, number)

    def write_event(self, number: int, t_ns: int, ribbon: str, what: str) -> None:
        """Adds what happened to a ribbon."""
        data = json.dumps({"ribbon": ribbon, "what": what}).encode()
        self._writer.add_message(self._events, t_ns, data, t_ns, number)

    def flush(self) -> None:
        """Makes the file whole up to here. Raises OSError; the file is then whole up to the flush before."""
        try:
            self._writer.flush()
        except OSError:
            self._abandon()
            raise

    def finish(self) -> None:
        """Completes and closes the file, unless that is done.

        Raises OSError, with the file closed and readable, perhaps without its index.
        """
        if self._closed:
            return
        self.flush()
        try:
            self._writer.finish()
            self._disk.flush()
        except OSError:
            self._abandon()
            raise
        self._close()

    def _abandon(self) -> None:
        """Closes a file that takes no more: its end needs 60 bytes, its index would need more."""
        end: Any = RecordBuilder()
        DataEnd(0).write(end)
        Footer(0, 0, 0).write(end)
        self._disk.write(end.end() + MCAP0_MAGIC)
        with contextlib.suppress(OSError):  # without an end it is still whole up to its last flush
            self._disk.flush()
        self._close()

    def _close(self) -> None:
        self._closed = True
        os.close(self._disk.descriptor)
