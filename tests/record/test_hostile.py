"""Files that are torn, damaged or made to mislead give what is intact in them, or a sentence."""

import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, Metadata
from record.conftest import HEADER
from ribbonhost import wire
from ribbonhost.errors import RibbonError
from ribbonhost.pipeline.replay import Replay
from ribbonhost.record import Received, Recorder, Recording, is_complete, recover
from ribbonhost.record.layout import HEADER as NAME

QUICK = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
PONG = wire.encode(wire.ClockPong(tag=1, t_host_us=2, t_receive_us=3, t_transmit_us=4))


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A few hundred messages of all kinds."""
    path = tmp_path_factory.mktemp("small") / "a.mcap"
    recorder = Recorder(path)
    tap = recorder.tap()
    recorder.start(HEADER)
    ping = wire.encode(wire.ClockPing(tag=1, t_host_us=2))
    for number in range(100):
        tap.sent(ping, number + 0.25)
        tap.received(PONG, number + 0.5)
    tap.spoiled(1, 2, 101.0)
    recorder.event("ribbon 0", "fell")
    recorder.close()
    return path.read_bytes()


def played(path: Path) -> int:
    """How many items a replay uses, or 0 if it refuses the file in a sentence."""
    sentence = ""
    try:
        recover(path, path.with_suffix(".new"))
        return sum(1 for _ in Replay([Recording(path)]).play())
    except RibbonError as error:
        sentence = str(error)
    assert sentence
    assert "\n" not in sentence
    return 0


@QUICK
@given(data=st.data())
def test_damaged_bytes_never_raise_anything_but_a_sentence(
    small: bytes, tmp_path: Path, data: st.DataObject
) -> None:
    content = bytearray(small)
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    played(path)


@QUICK
@given(data=st.data())
def test_damage_behind_a_right_checksum_never_raises_anything_but_a_sentence(
    small: bytes, tmp_path: Path, data: st.DataObject
) -> None:
    """Records that no CRC protects from somebody who writes them on purpose."""
    begin = small.index(b"/events")  # inside the first chunk
    content = bytearray(small)
    for _ in range(data.draw(st.integers(1, 10))):
        at = data.draw(st.integers(begin, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    stripped = bytes(content).replace(struct.pack("<I", _chunk_crc(small)), bytes(4))
    path = tmp_path / "a.mcap"
    path.write_bytes(stripped)
    played(path)


@QUICK
@given(length=st.integers(0, 30_000))
def test_a_file_that_ends_anywhere_gives_what_came_before(small: bytes, tmp_path: Path, length: int) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(small[: min(length, len(small) - 1)])
    assert not is_complete(path)
    played(path)


def test_a_file_of_another_kind_is_told_from_one_that_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"garbage\n")
    with pytest.raises(RibbonError, match="is not an MCAP file"):
        is_complete(path)


@QUICK
@given(values=st.dictionaries(st.sampled_from(sorted(HEADER.to_metadata())), st.text(max_size=30)))
def test_a_header_that_cannot_be_is_refused(tmp_path: Path, values: dict[str, str]) -> None:
    record = RecordBuilder()
    Metadata(name=NAME, metadata=HEADER.to_metadata() | values).write(record)
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + record.end())  # type: ignore[no-untyped-call]
    played(path)


def test_a_damaged_chunk_costs_itself_only(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorder = Recorder(path)
    tap = recorder.tap()
    recorder.start(HEADER)
    for _ in range(20_000):
        tap.received(PONG, 1.0)
    recorder.close()
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)
    recording = Recording(path)
    kept = sum(isinstance(item, Received) for item in recording.items())
    assert recording.damaged == 1
    assert 10_000 < kept < 20_000
    saved = recover(path)
    assert (saved.damaged, saved.messages) == (1, kept)
    assert sum(1 for _ in Recording(path).items()) == kept


def test_what_another_program_compressed_is_named(tmp_path: Path) -> None:
    record = RecordBuilder()
    Metadata(name=NAME, metadata=HEADER.to_metadata()).write(record)
    Chunk("zstd", b"xx", 0, 0, 0, 1 << 60).write(record)
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + record.end())  # type: ignore[no-untyped-call]
    with pytest.raises(RibbonError, match="compressed"):
        Recording(path)


def _chunk_crc(content: bytes) -> int:
    """The CRC of the only chunk of a small recording."""
    at = 8
    while content[at] != 0x06:
        at += 9 + struct.unpack_from("<Q", content, at + 1)[0]
    crc: int = struct.unpack_from("<I", content, at + 9 + 24)[0]
    data_at = at + 9 + 28 + 4
    (length,) = struct.unpack_from("<Q", content, data_at)
    assert zlib.crc32(content[data_at + 8 : data_at + 8 + length]) == crc
    return crc
