"""Makes a recording whole whose writing was cut off."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, IndexType, Writer

from ribbonhost.errors import RecordingError
from ribbonhost.record.file import CHUNK_BYTES
from ribbonhost.record.layout import NS, PROFILE
from ribbonhost.record.reader import Recording, RecordReader


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


def recover(path: Path, output: Path | None = None) -> Recovered:
    """Copies all that is intact into a whole file at `output`, or in place of the torn one.

    The file appears at once, when it is whole. Raises RecordingError if there is nothing to save, the file is
    no recording, or the new one cannot be written.
    """
    Recording(path)  # refuses what is none
    target = output or path
    part = target.with_name(f".{target.name}.part")
    try:
        before = path.stat().st_size
        with part.open("wb") as file:
            messages, seconds, damaged = _copy(path, file)
            file.flush()
            os.fsync(file.fileno())
        after = part.stat().st_size
        os.replace(part, target)
    except OSError as error:
        raise RecordingError(f"{target} cannot be written: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return Recovered(messages, seconds, damaged, before, after)


def _copy(path: Path, file: IO[bytes]) -> tuple[int, float, int]:
    writer: Any = Writer(
        file,
        chunk_size=CHUNK_BYTES,
        compression=CompressionType.NONE,
        index_types=IndexType.CHUNK | IndexType.METADATA,
    )
    writer.start(profile=PROFILE)
    reader = RecordReader(path)
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    count, first_ns, last_ns = 0, 0, 0
    for record in reader:
        match record:
            case Schema() if record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            case Channel() if record.id not in channels:
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
                )
            case Metadata():
                writer.add_metadata(record.name, record.metadata)
            case Message() if record.channel_id in channels:
                writer.add_message(
                    channels[record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
                first_ns = record.log_time if not count else min(first_ns, record.log_time)
                last_ns = max(last_ns, record.log_time)
                count += 1
            case _:
                pass
    writer.finish()
    return count, (last_ns - first_ns) / NS, reader.damaged
