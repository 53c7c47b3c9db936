"""The codecs in C and Python, and the readers of frames, against the golden bytes of vectors.json."""

from __future__ import annotations

import json
import struct
from typing import Any

import both_codecs as both
import numpy as np
import pytest
import slow_packer as slow
import vector_cases
from ribbonhil._firmware import ffi, lib
from ribbonhost import framing, wire

VECTORS = json.loads(vector_cases.VECTORS.read_text(encoding="utf-8"))


def cases(key: str) -> Any:
    """Each case of a list of the file as a test of its own, named by its note."""
    names = [f"{case.get('type', '')} {case['note']}".strip() for case in VECTORS[key]]
    return pytest.mark.parametrize("case", VECTORS[key], ids=names)


def golden(name: str, note: str) -> bytes:
    (case,) = (c for c in VECTORS["messages"] if (c["type"], c["note"]) == (name, note))
    return bytes.fromhex(case["bytes"])


def test_file_is_what_the_slow_packer_makes_of_the_cases() -> None:
    assert vector_cases.VECTORS.read_text(encoding="utf-8") == vector_cases.text()


def test_bytes_worked_by_hand_are_in_the_file() -> None:
    assert golden("clock_ping", "largest values, all items") == bytes.fromhex("12 ffff ffffffffffffffff")
    assert golden("clock_pong", "different bytes, three items") == struct.pack(
        "<BHQII", 0x13, 0x0102, 0x030405060708090A, 0x0B0C0D0E, 0x0F101112
    )
    assert golden("command", "different bytes, three items") == struct.pack(
        "<BHBIB3s", 0x10, 0x0102, 3, 0x04050607, 3, b"\x08\x09\x0a"
    )
    assert golden("orient", "smallest values, one item") == bytes.fromhex(
        "02 00000000 0000 01 000000000000 00"
    )
    assert golden("orient_compact", "smallest values, one item") == bytes.fromhex(
        "03 00000000 0000 01 ffffffff 00"
    )
    # Codes 16383 (0), 32765 and 16383 over index 3, valid: -(16383 - 32765) / 16383 / sqrt(2) = 0.70706.
    word = 3 | 16383 << 2 | 32765 << 17 | 16383 << 32 | 1 << 47
    assert golden("orient", "largest values, all items") == struct.pack(
        "<BIHB", 2, 2**32 - 1, 65535, 32
    ) + 32 * (word.to_bytes(6, "little") + b"\xff")
    # Each item: reason 0, three times the least number of 16 and of 24 bits.
    assert golden("raw", "smallest values, one item") == bytes.fromhex(
        "04 00000000 0000 01 01  00 0080 0080 0080  00 000080 000080 000080  0000 0000 0000 0000 0000 0000"
    )
    # temperature_c is 327.67 degrees, 0x7fff hundredths of one.
    assert golden("status", "largest values, all items") == (
        b"\x05"
        + b"\xff" * 39
        + b"\xff\x7f"
        + b"\xff" * 12
        + b"\x40"
        + b"\xff" * 3 * 64
        + b"\x40"
        + b"\xff\x7f" * 64
    )
    assert golden("calibration", "smallest values, no items") == struct.pack(
        "<HBBIfff", 0, 0, 0, 0, *(3 * [-3.4028234663852886e38])
    )
    # 0.5 / (sqrt(1/2) / 511) is 361.3: two of the three components round to it, the third a step further off.
    (tie,) = (c for c in VECTORS["quaternions"] if c["type"] == "smallest_three_10" and c["q"] == [0.5] * 4)
    codes = {tuple(int(word, 16) >> shift & 1023 for shift in (2, 12, 22)) for word in tie["words"]}
    assert codes == {(872, 872, 873), (872, 873, 872), (873, 872, 872)}


def test_check_values_of_the_schema_hold() -> None:
    table, digits = slow.SCHEMA["framing"], b"123456789"
    for crc in (slow.crc16, framing.crc16, lambda data: lib.framing_crc16(data, len(data))):
        assert crc(digits) == table["crc16"]["check"]
    for crc in (slow.crc32, framing.crc32, lambda data: lib.framing_crc32(data, len(data))):
        assert crc(digits) == table["crc32"]["check"]


@cases("messages")
def test_message_packs_to_its_golden_bytes(case: dict[str, Any]) -> None:
    expected = bytes.fromhex(case["bytes"])
    assert both.python_pack(case["type"], case["fields"]) == expected
    assert both.c_pack(case["type"], case["fields"]) == expected


@cases("messages")
def test_golden_bytes_unpack_to_their_message(case: dict[str, Any]) -> None:
    data = bytes.fromhex(case["bytes"])
    fields, surplus = both.python_unpack(case["type"], data)
    both.assert_same(case["type"], fields, case["fields"])
    assert surplus == 0
    fields, used = both.c_unpack(case["type"], data)
    assert used == len(data)
    both.assert_same(case["type"], fields, case["fields"])


def pack_quaternion(kind: str, q: list[Any]) -> tuple[int, int]:
    """(word from Python, word from C)."""
    name = "node" if kind == "smallest_three_15" else "node_compact"
    fields = {"t_us": 0, "sequence": 0, "node_count": 1}
    nodes = [{"q_world_node": [float(c) for c in q], "quality": 0}]
    message = {"node": "orient", "node_compact": "orient_compact"}[name]
    packed = (
        both.python_pack(message, fields | {"nodes": nodes}),
        both.c_pack(message, fields | {"nodes": nodes}),
    )
    python, c = (int.from_bytes(data[8:-1], "little") for data in packed)
    return python, c


@cases("quaternions")
def test_quaternion_packs_to_a_nearest_word(case: dict[str, Any]) -> None:
    python, c = pack_quaternion(case["type"], case["q"])
    assert f"0x{python:x}" in case["words"]
    assert c == python


@cases("words")
def test_word_unpacks_to_its_quaternion(case: dict[str, Any]) -> None:
    full = case["type"] == "smallest_three_15"
    name, size = ("orient", 6) if full else ("orient_compact", 4)
    head = struct.pack("<BIHB", slow.PACKETS[name]["id"], 0, 0, 1)
    packet = head + int(case["word"], 16).to_bytes(size, "little") + b"\0"
    for unpacked in (both.python_unpack(name, packet)[0], both.c_unpack(name, packet)[0]):
        q = unpacked["nodes"][0]["q_world_node"]
        assert (q is None) == (case["q"] is None)
        if q is not None:
            np.testing.assert_allclose(q, case["q"], rtol=0, atol=1e-6)


def c_packets(data: bytes) -> tuple[list[bytes], Any]:
    """(packets, reader) of the firmware's own reader."""
    reader, packet = ffi.new("struct framing_reader *"), ffi.new("const uint8_t **")
    lib.framing_reader_init(reader)
    lengths = ((lib.framing_read_byte(reader, byte, packet), packet) for byte in data)
    return [bytes(ffi.buffer(p[0], n)) for n, p in lengths if n], reader


@cases("streams")
def test_stream_is_read_as_the_file_says(case: dict[str, Any]) -> None:
    data = bytes.fromhex(case["bytes"])
    deframer = framing.Deframer()
    packets = deframer.feed(data)
    assert (deframer.crc_errors, deframer.malformed) == (case["crc_errors"], case["malformed"])
    from_c, reader = c_packets(data)
    assert from_c == packets
    assert (reader.crc_errors, reader.malformed) == (case["crc_errors"], case["malformed"])
    found, surplus_bytes = [], 0
    for packet in packets:
        try:
            message, surplus = wire.decode(packet)
        except wire.UnknownPacketError:
            found.append("unknown")
        except wire.MalformedPacketError:
            found.append("malformed")
        else:
            found.append(wire.PacketId(packet[0]).name.lower())
            assert type(message) is both.class_of(found[-1])
            surplus_bytes += surplus
    assert found == case["packets"]
    assert surplus_bytes == case["surplus_bytes"]


@cases("streams")
def test_how_a_stream_is_cut_makes_no_difference(case: dict[str, Any]) -> None:
    data = bytes.fromhex(case["bytes"])
    whole, bytewise, ragged = framing.Deframer(), framing.Deframer(), framing.Deframer()
    expected = whole.feed(data)
    assert [p for i in range(len(data)) for p in bytewise.feed(data[i : i + 1])] == expected
    assert [p for i in range(0, len(data), 7) for p in ragged.feed(data[i : i + 7])] == expected
    for other in (bytewise, ragged):
        assert (other.crc_errors, other.malformed) == (whole.crc_errors, whole.malformed)
