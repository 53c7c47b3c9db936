"""Frames in C and Python: the same bytes, nothing lost but what is broken, and memory that does not grow."""

from __future__ import annotations

import random
import sys

import numpy as np
import pytest
import slow_packer as slow
from hypothesis import given, settings
from hypothesis import strategies as st
from ribbonhil._firmware import ffi, lib
from ribbonhost import framing, wire

QUICK = settings(derandomize=True, deadline=None, max_examples=200)
# Runs of other bytes between zeros are what COBS cuts: 253 to 255 and their multiples are its edges.
RUN = st.integers(1, 255).flatmap(
    lambda byte: st.sampled_from([0, 1, 5, 253, 254, 255, 508]).map(lambda n: bytes([byte]) * n)
)
PACKETS = st.one_of(
    st.binary(min_size=1, max_size=wire.MAX_PACKET_BYTES),
    st.lists(RUN, min_size=1, max_size=6).map(
        lambda runs: (b"\x07" + b"\0".join(runs))[: wire.MAX_PACKET_BYTES]
    ),
)


def c_frame(packet: bytes, capacity: int = int(lib.FRAMING_MAX_FRAME_BYTES)) -> bytes:
    out = ffi.new("uint8_t[]", capacity)
    return bytes(ffi.buffer(out, lib.framing_encode(packet, len(packet), out, capacity)))


class CReader:
    """The firmware's reader with the face of Deframer."""

    def __init__(self) -> None:
        self._reader = ffi.new("struct framing_reader *")
        self._packet = ffi.new("const uint8_t **")
        lib.framing_reader_init(self._reader)

    def feed(self, data: bytes) -> list[bytes]:
        lengths = (lib.framing_read_byte(self._reader, byte, self._packet) for byte in data)
        return [bytes(ffi.buffer(self._packet[0], n)) for n in lengths if n]

    @property
    def crc_errors(self) -> int:
        return int(self._reader.crc_errors)

    @property
    def malformed(self) -> int:
        return int(self._reader.malformed)


READERS = pytest.mark.parametrize("reader_type", [framing.Deframer, CReader], ids=["python", "c"])
Reader = framing.Deframer | CReader


@given(PACKETS)
@QUICK
def test_frames_are_the_same_everywhere_and_read_back(packet: bytes) -> None:
    frame = framing.encode_frame(packet)
    assert frame == c_frame(packet) == slow.frame(packet)
    assert frame.index(0) == len(frame) - 1
    assert framing.Deframer().feed(frame) == CReader().feed(frame) == [packet]


def test_packets_of_every_length_without_a_zero_are_framed_the_same_everywhere() -> None:
    """Blocks of 254 that end exactly where the content does are among them."""
    for n in range(1, wire.MAX_PACKET_BYTES + 1):
        packet = bytes(1 + (7 * n + i) % 255 for i in range(n))
        frame = framing.encode_frame(packet)
        assert frame == c_frame(packet) == slow.frame(packet)
        assert framing.Deframer().feed(frame) == CReader().feed(frame) == [packet]


@given(st.binary(max_size=1500), st.integers(0, 3))
@QUICK
def test_both_readers_agree_on_any_bytes(data: bytes, zeros: int) -> None:
    data = bytes(byte if byte > zeros * 20 else 0 for byte in data)
    python, c = framing.Deframer(), CReader()
    assert python.feed(data) == c.feed(data)
    assert (python.crc_errors, python.malformed) == (c.crc_errors, c.malformed)


@READERS
def test_corrupt_frame_loses_only_itself(reader_type: type[Reader]) -> None:
    source = random.Random(5)
    packets = [bytes([1 + i % 200]) + source.randbytes(source.randrange(1, 300)) for i in range(200)]
    stream, kept = b"", []
    for i, packet in enumerate(packets):
        frame = framing.encode_frame(packet)
        if i % 3 == 0:
            at = source.randrange(len(frame) - 1)
            bit = next(b for b in (1, 2, 4) if frame[at] ^ b)
            frame = frame[:at] + bytes([frame[at] ^ bit]) + frame[at + 1 :]
        else:
            kept.append(packet)
        stream += frame
    reader = reader_type()
    assert reader.feed(stream) == kept
    assert reader.crc_errors + reader.malformed == len(packets) - len(kept)
    assert reader.crc_errors > 0


@READERS
def test_reader_starts_in_the_middle_of_a_frame(reader_type: type[Reader]) -> None:
    frame = framing.encode_frame(bytes(range(1, 120)))
    for cut in range(1, len(frame)):
        reader = reader_type()
        assert reader.feed(frame[cut:] + frame)[-1:] == [bytes(range(1, 120))]
        assert reader.crc_errors + reader.malformed == (cut < len(frame) - 1)


def test_deframer_holds_one_frame_at_most_whatever_arrives() -> None:
    deframer = framing.Deframer()
    for _ in range(200):
        assert deframer.feed(b"\x55" * 10_000) == []
    assert sys.getsizeof(deframer._partial) < 2 * framing.MAX_COBS_BYTES
    assert deframer.malformed == 0
    packet = b"\x01\x02"
    assert deframer.feed(b"\0" + framing.encode_frame(packet)) == [packet]
    assert deframer.malformed == 1


def test_encoding_refuses_what_is_no_packet() -> None:
    longest = bytes(wire.MAX_PACKET_BYTES)
    for packet in (b"", longest + b"\0"):
        with pytest.raises(wire.WireError, match=f"1 to {wire.MAX_PACKET_BYTES} bytes, not {len(packet)}"):
            framing.encode_frame(packet)
        assert c_frame(packet) == b""
    assert framing.Deframer().feed(framing.encode_frame(longest)) == [longest]
    assert CReader().feed(c_frame(longest)) == [longest]


def test_c_frame_needs_the_room_its_header_says() -> None:
    packet = b"\x01" * 300
    room = 300 + 2 + 302 // 254 + 2
    assert c_frame(packet, room)
    assert c_frame(packet, room - 1) == b""
    assert len(framing.encode_frame(b"\x01" * wire.MAX_PACKET_BYTES)) <= lib.FRAMING_MAX_FRAME_BYTES


def nodes(
    array: type[wire.NodeArray] | type[wire.NodeCompactArray], count: int, seed: int
) -> tuple[int, ...]:
    """Sizes of frames of so many random nodes, over attitudes and qualities."""
    source = np.random.default_rng(seed)
    kind = wire.Orient if array is wire.NodeArray else wire.OrientCompact
    sizes = []
    for _ in range(200):
        filled = array(
            q_world_node=source.standard_normal((count, 4)),
            valid=source.random(count) < 0.9,
            quality=source.integers(0, 256, count),
        )
        t_us, sequence = (int(source.integers(1 << bits)) for bits in (32, 16))
        sizes.append(len(framing.encode_frame(wire.encode(kind(t_us=t_us, sequence=sequence, nodes=filled)))))
    return tuple(sizes)


def test_frames_of_sixteen_nodes_are_small() -> None:
    assert max(nodes(wire.NodeArray, 16, 1)) <= 128
    assert max(nodes(wire.NodeCompactArray, 16, 2)) <= 96
