"""A recording with decoded channels beside what was recorded, for viewers of MCAP files."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

from mcap.writer import CompressionType, Writer

from ribbonhost.record.file import CHUNK_BYTES
from ribbonhost.record.layout import PROFILE, nanoseconds
from ribbonhost.record.reader import Recording
from ribbonhost.record.recover import copy_records, replace_whole


@dataclass(frozen=True)
class Decoded:
    """A message of a decoded channel.

    Attributes:
        topic: of its channel.
        schema: name, encoding and data of the schema; the message has the same encoding.
        t_host_s: when it was, on the host's clock of the recording.
        data: the message.
    """

    topic: str
    schema: tuple[str, str, bytes]
    t_host_s: float
    data: bytes


def finalise(path: Path, output: Path, decoded: Iterable[Decoded]) -> int:
    """Writes what was recorded, with log times since 1970, and the decoded messages; returns their number.

    The recording plays as before, to the bit. Decoded channels that it had are replaced. `output` may be
    `path`; the file appears at once, when it is whole. Raises RecordingError.
    """
    header = Recording(path).header
    header = replace(header, log_offset_ns=header.wall_offset_ns)

    def write(file: IO[bytes]) -> int:
        writer: Any = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
        writer.start(profile=PROFILE)
        copy_records(path, writer, header)
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        count = 0
        for message in decoded:
            name, encoding, data = message.schema
            if name not in schemas:
                schemas[name] = writer.register_schema(name, encoding, data)
            if message.topic not in channels:
                channels[message.topic] = writer.register_channel(message.topic, encoding, schemas[name])
            t_ns = nanoseconds(message.t_host_s) + header.log_offset_ns
            writer.add_message(channels[message.topic], t_ns, message.data, t_ns)
            count += 1
        writer.finish()
        return count

    return replace_whole(output, write)
