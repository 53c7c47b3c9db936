"""Makes a recording whole whose writing was cut off."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, TypeVar

from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, IndexType, Writer

from ribbonhost.errors import RecordingError
from ribbonhost.record.file import CHUNK_BYTES
from ribbonhost.record.layout import HEADER, NS, PROFILE, Header, topics_of
from ribbonhost.record.reader import Recording, RecordReader

T = TypeVar("T")

PROGRESS_MESSAGES = 5000
"""So often it is told how far it is."""


@dataclass(frozen=True)
class Recovered:
    """What was saved.

    messages: how many. seconds: from the first to the last. damaged: pieces that were left out.
    bytes_before, bytes_after: lengths of the files.
    """

    messages: int
    seconds: float
    damaged: int
    bytes_before: int
    bytes_after: int


def recover(
    path: Path, output: Path | None = None, on_progress: Callable[[float], None] = lambda share: None
) -> Recovered:
    """Copies all that is intact into a whole file at `output`, or in place of the torn one.

    `on_progress` is told which share, 0 to 1, is done.

    The file appears at once, when it is whole. Raises RecordingError if there is nothing to save, the file is
    no recording, or the new one cannot be written.
    """
    Recording(path)  # refuses what is none
    target = output or path
    before = path.stat().st_size

    def copy(file: IO[bytes]) -> tuple[int, float, int]:
        writer: Any = Writer(
            file,
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.NONE,
            index_types=IndexType.CHUNK | IndexType.METADATA,
        )
        writer.start(profile=PROFILE)
        saved = copy_records(path, writer, on_progress=on_progress)
        writer.finish()
        return saved

    messages, seconds, damaged = replace_whole(target, copy)
    return Recovered(messages, seconds, damaged, before, target.stat().st_size)


def replace_whole(target: Path, write: Callable[[IO[bytes]], T]) -> T:
    """Writes a file that appears, or takes the place of another, at once, when it is whole.

    Raises RecordingError if it cannot be written.
    """
    part = target.with_name(f".{target.name}.part")
    try:
        with part.open("wb") as file:
            result = write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, target)
    except OSError as error:
        raise RecordingError(f"{target} cannot be written: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return result


def copy_records(
    path: Path,
    writer: Any,
    header: Header | None = None,
    on_progress: Callable[[float], None] = lambda share: None,
) -> tuple[int, float, int]:
    """Copies what a recording holds to an MCAP writer that was started.

    With another header, only the channels of that are copied, and log times are moved as it says. Returns how
    many messages there were, seconds from the first to the last, and how many pieces were damaged.
    """
    reader = RecordReader(path)
    shift_ns = 0
    topics: set[str] | None = None
    if header:
        shift_ns = header.log_offset_ns - Recording(path).header.log_offset_ns
        topics = topics_of(header)
        writer.add_metadata(HEADER, header.to_metadata())
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    count, first_ns, last_ns = 0, 0, 0
    for record in reader:
        match record:
            case Schema() if record.id not in schemas and topics is None:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            case Channel() if record.id not in channels and (topics is None or record.topic in topics):
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
                )
            case Metadata() if not (header and record.name == HEADER):
                writer.add_metadata(record.name, record.metadata)
            case Message() if record.channel_id in channels:
                writer.add_message(
                    channels[record.channel_id],
                    record.log_time + shift_ns,
                    record.data,
                    record.publish_time + shift_ns,
                    record.sequence,
                )
                first_ns = record.log_time if not count else min(first_ns, record.log_time)
                last_ns = max(last_ns, record.log_time)
                count += 1
                if count % PROGRESS_MESSAGES == 0:
                    on_progress(reader.share)
            case _:
                pass
    return count, (last_ns - first_ns) / NS, reader.damaged
