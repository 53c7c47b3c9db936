"""Writes protocol/vectors.json, when run as a program: these cases with the bytes of slow_packer.py."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Mapping
from typing import Any

import slow_packer as slow

VECTORS = slow.PROTOCOL / "vectors.json"
ABOUT = """\
Golden bytes of the wire protocol. Made by tests/protocol/vector_cases.py with tests/protocol/slow_packer.py,
a second reading of schema.toml in exact arithmetic that shares no code with the generator; several are
worked by hand in tests/protocol/test_vectors.py. Bytes are hexadecimal, u8 arrays too; an invalid value is
null; a quaternion is [w, x, y, z]. 'messages': packets and records with their values, to be packed and
unpacked. 'quaternions': words of which any is right for q, a tie where there are several. 'words': what a
reader makes of words that our writers do not all produce. 'streams': bytes from a link, the packets that a
reader must find in them (by type, or why not), and what it must count."""
LARGEST_F32 = 3.4028234663852886e38
SMALLEST_F32 = 1.401298464324817e-45
KINDS = tuple(slow.QUATERNIONS)


def document() -> dict[str, Any]:
    """All of vectors.json."""
    return {
        "about": " ".join(ABOUT.split()),
        "messages": [m for name in (*slow.PACKETS, *slow.RECORDS) for m in messages(name)],
        "quaternions": [case for kind in KINDS for case in quaternions(kind)],
        "words": [case for kind in KINDS for case in words(kind)],
        "streams": streams(),
    }


def text() -> str:
    """The document with one case a line."""
    parts = []
    for key, value in document().items():
        rows = ",\n".join("  " + json.dumps(row) for row in value) if isinstance(value, list) else ""
        parts.append(f'"{key}": ' + (f"[\n{rows}\n]" if rows else json.dumps(value)))
    return "{\n" + ",\n".join(parts) + "\n}\n"


# ---------------------------------------------------------------- messages


def messages(name: str) -> list[dict[str, Any]]:
    """Smallest, largest and tellingly different values of all fields, with no, all and three items."""
    cases = [
        ("smallest values, no items", smallest, lambda most: 0),
        ("smallest values, one item", smallest, lambda most: 1),
        ("largest values, all items", largest, lambda most: most),
        ("different bytes, three items", Different(), lambda most: min(3, most)),
    ]
    if not any(isinstance(row.get("count"), str) for row in _rows(name)):
        cases = [case for case in cases if "one item" not in case[0]]
    return [message(name, note, values(name, choose, count)) for note, choose, count in cases]


def message(name: str, note: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    """A case: its type, what is special, its values and bytes."""
    return {"type": name, "note": note, "fields": fields, "bytes": slow.pack(name, fields).hex()}


def _rows(name: str) -> list[dict[str, Any]]:
    return list((slow.PACKETS.get(name) or slow.RECORDS[name])["fields"])


def values(
    name: str, choose: Callable[[Mapping[str, Any]], Any], count: Callable[[int], int]
) -> dict[str, Any]:
    """Values of all fields of a message, chosen field by field, with counts that fit their arrays."""
    rows, fields = _rows(name), {}
    for row in rows:
        if any(other.get("count") == row["name"] for other in rows):
            most = row["range"][1]
            fields[row["name"]] = count(slow.SCHEMA["wire"].get(most, most))
            continue
        length = fields[row["count"]] if isinstance(row.get("count"), str) else row.get("count", 1)
        if "struct" in row:
            members = slow.STRUCTS[row["struct"]]["fields"]
            fields[row["name"]] = [
                {m["name"]: _value(m, m.get("count", 1), choose) for m in members} for _ in range(length)
            ]
        else:
            fields[row["name"]] = _value(row, length, choose)
    return fields


def _value(row: Mapping[str, Any], length: int, choose: Callable[[Mapping[str, Any]], Any]) -> Any:
    if "count" not in row:
        return choose(row)
    several = [choose(row) for _ in range(length)]
    return bytes(several).hex() if row["type"] == "u8" else several


def _limits(row: Mapping[str, Any]) -> tuple[int, int]:
    bits = int(row["type"][1:])
    return (0, (1 << bits) - 1) if row["type"][0] == "u" else (-(1 << bits - 1), (1 << bits - 1) - 1)


def smallest(row: Mapping[str, Any]) -> Any:
    """Least number of a type; an invalid quaternion."""
    if row["type"] in slow.QUATERNIONS:
        return None
    if row["type"] == "f32":
        return -LARGEST_F32
    return (_limits(row)[0] + 1) * row["scale"] if "scale" in row else _limits(row)[0]


def largest(row: Mapping[str, Any]) -> Any:
    """Greatest number of a type; a quaternion with two components as large as a code can say."""
    if row["type"] in slow.QUATERNIONS:
        levels = (1 << slow.QUATERNIONS[row["type"]]["bits"] - 1) - 1
        return slow.quaternion(row["type"], slow.join(row["type"], 3, (levels, 2 * levels - 1, levels)))
    if row["type"] == "f32":
        return LARGEST_F32
    return _limits(row)[1] * row["scale"] if "scale" in row else _limits(row)[1]


class Different:
    """Numbers of different bytes; each fourth quaternion invalid, f32 with a denormal and -0."""

    def __init__(self) -> None:
        self._byte = 0
        self._floats = 0
        self._random = random.Random(7)

    def __call__(self, row: Mapping[str, Any]) -> Any:
        if row["type"] in slow.QUATERNIONS:
            self._byte += 1
            return None if self._byte % 4 == 0 else self._quaternion(row["type"])
        if row["type"] == "f32":
            self._floats += 1
            return (0.15625, SMALLEST_F32, -0.0, -1234.5)[self._floats % 4]
        if "scale" in row:
            return None
        low, high = _limits(row)
        number = 0
        for _ in range((high - low).bit_length() // 8):
            self._byte = self._byte % 127 + 1
            number = number << 8 | self._byte
        return number if low == 0 else low + number

    def _quaternion(self, kind: str) -> list[float] | None:
        """One that a word says exactly, so that only that word is right."""
        levels = (1 << slow.QUATERNIONS[kind]["bits"] - 1) - 1
        codes = tuple(levels + self._random.randrange(-levels // 2, levels // 2) for _ in range(3))
        return slow.quaternion(kind, slow.join(kind, self._random.randrange(4), codes))


# ---------------------------------------------------------------- quaternions


def quaternions(kind: str) -> list[dict[str, Any]]:
    """Quaternions to pack, with the words that are right."""
    half = [0.5, 0.5, 0.5, 0.5]
    crooked = [0.9, 0.1, -0.2, 0.3]
    cases: list[tuple[str, list[Any]]] = [("identity", [1, 0, 0, 0])]
    cases += [("half a turn", [0, 1, 0, 0]), ("half a turn", [0, 0, 1, 0]), ("half a turn", [0, 0, 0, -1])]
    cases += [(f"largest component {i}", crooked[-i:] + crooked[:-i]) for i in range(4)]
    cases += [(f"-q, largest component {i}", [-c for c in crooked[-i:] + crooked[:-i]]) for i in range(4)]
    cases += [("all equal: the first is the largest", half)]
    cases += [
        ("equal magnitudes", [s * 0.5 for s in signs])
        for signs in ((-1, 1, 1, 1), (1, -1, 1, -1), (-1, -1, -1, -1))
    ]
    cases += [("two equal", [0, 0.5**0.5, 0, 0.5**0.5]), ("two equal", [0, 0, -(0.5**0.5), 0.5**0.5])]
    cases += [("not of unit length", [c * s for c in crooked]) for s in (1e-15, 1e-6, 1e6, 1e15)]
    found = [{"type": kind, "note": note, "q": q, "words": _hex(slow.words(kind, q))} for note, q in cases]
    bad: list[tuple[str, list[Any]]] = [
        ("zero", [0, 0, 0, 0]),
        ("NaN", ["nan", 0, 0, 1]),
        ("NaN", [1, 0, 0, "nan"]),
        ("infinite", [0, "inf", 0, 0]),
        ("infinite", ["-inf", 0, "inf", 0]),
        ("too long to square", [1e25, 0, 0, 0]),
        ("too short to square", [0, 0, 1e-25, 0]),
        ("denormal", [SMALLEST_F32, SMALLEST_F32, 0, 0]),
    ]
    return found + [
        {"type": kind, "note": note, "q": q, "words": _hex(slow.words(kind, None))} for note, q in bad
    ]


def words(kind: str) -> list[dict[str, Any]]:
    """Words to unpack, also those that a writer need not produce."""
    levels = (1 << slow.QUATERNIONS[kind]["bits"] - 1) - 1
    cases = [(f"largest component {i}", i, (levels + 1, levels - 2, levels)) for i in range(4)]
    cases += [("code of all ones", 1, (2 * levels + 1, levels, levels))]
    cases += [
        ("least codes", 2, (0, levels, levels)),
        ("another is as large", 0, (2 * levels, levels, levels)),
    ]
    cases += [("another is larger", 0, (levels, 2 * levels, levels + levels // 2))]
    cases += [("three longer than 1", 3, (0, 2 * levels, 0)), ("three longer than 1", 0, (0, 0, 0))]
    cases += [
        ("three of length 1", 1, (0, 2 * levels, levels)),
        ("a step more", 1, (0, 2 * levels, levels + 1)),
    ]
    all_words = [(note, slow.join(kind, index, codes)) for note, index, codes in cases]
    table = slow.QUATERNIONS[kind]
    if "valid_bit" in table:
        all_words += [("valid bit not set", all_words[0][1] - (1 << table["valid_bit"])), ("zeros", 0)]
    all_words += [("ones", (1 << table["word_bits"]) - 1)]
    return [
        {"type": kind, "note": n, "word": _hex([w])[0], "q": slow.quaternion(kind, w)} for n, w in all_words
    ]


def _hex(numbers: list[int]) -> list[str]:
    return [f"0x{number:x}" for number in numbers]


# ---------------------------------------------------------------- streams


def streams() -> list[dict[str, Any]]:
    """Bytes from a link: whole frames, and each way in which one can be broken."""
    orient = slow.pack("orient", values("orient", Different(), lambda most: 3))
    ping = slow.pack("clock_ping", {"tag": 0, "t_host_us": 0x0123456789ABCDEF})
    command = slow.pack("command", {"tag": 7, "command": 3, "argument": 100, "data_count": 0, "data": ""})
    first, second = slow.frame(orient), slow.frame(ping)
    longest = bytes([200]) + bytes(1 + i % 255 for i in range(slow.SCHEMA["wire"]["max_packet_bytes"] - 1))
    with_data = slow.pack(
        "command", {"tag": 7, "command": 8, "argument": 0, "data_count": 3, "data": "000102"}
    )
    bad_check = ping + (slow.crc16(ping) ^ 0x0100).to_bytes(2, "little")
    cases: list[tuple[str, bytes, list[str], dict[str, int]]] = [
        ("nothing", b"", [], {}),
        ("one frame", first, ["orient"], {}),
        ("two frames", first + second, ["orient", "clock_ping"], {}),
        ("a frame of zeros and little else", slow.frame(command), ["command"], {}),
        ("a frame that has not ended", first + second[:-1], ["orient"], {}),
        (
            "doubled and leading delimiters",
            b"\0\0" + first + b"\0\0\0" + second,
            ["orient", "clock_ping"],
            {},
        ),
        ("the longest packet, of an unknown type", slow.frame(longest), ["unknown"], {}),
        ("a flipped bit in a field", flip(first, 12) + second, ["clock_ping"], {"crc_errors": 1}),
        ("a flipped bit in the CRC", slow.cobs(bad_check) + b"\0" + first, ["orient"], {"crc_errors": 1}),
        (
            "a code byte beyond the end",
            bytes([first[0] + 100]) + first[1:] + second,
            ["clock_ping"],
            {"malformed": 1},
        ),
        ("only a code byte beyond the end", b"\xff\0" + second, ["clock_ping"], {"malformed": 1}),
        ("cut short by a delimiter", first[:9] + b"\0" + second, ["clock_ping"], {"malformed": 1}),
        ("bytes lost", first[:9] + first[20:] + second, ["clock_ping"], {"malformed": 1}),
        ("a delimiter lost: two frames in one", first[:-1] + second + first, ["orient"], {"crc_errors": 1}),
        ("noise before a frame", b"\x05\xaa\x55" + first + second, ["clock_ping"], {"malformed": 1}),
        ("one byte: too short for a CRC", slow.cobs(b"\x12") + b"\0" + first, ["orient"], {"malformed": 1}),
        ("a CRC and no packet", slow.frame(b"") + first, ["orient"], {"malformed": 1}),
        (
            "one byte longer than any packet",
            slow.frame(longest + b"\1") + first,
            ["orient"],
            {"malformed": 1},
        ),
        ("thousands of bytes and no delimiter", b"\x02" * 5000 + b"\0" + first, ["orient"], {"malformed": 1}),
        (
            "blocks of 254 without end",
            (b"\xff" + b"\x01" * 254) * 9 + b"\0" + first,
            ["orient"],
            {"malformed": 1},
        ),
        (
            "appended fields",
            slow.frame(ping + b"\x01\x02\x03") + first,
            ["clock_ping", "orient"],
            {"surplus_bytes": 3},
        ),
        ("appended after an array", slow.frame(with_data + bytes(9)), ["command"], {"surplus_bytes": 9}),
        ("an unknown type", slow.frame(b"\x7f\x01\x02") + first, ["unknown", "orient"], {}),
        ("the reserved type 0", slow.frame(b"\0\x01\x02"), ["unknown"], {}),
        ("a packet that ends within a field", slow.frame(ping[:-1]) + first, ["malformed", "orient"], {}),
        ("a packet with fewer items than its count", slow.frame(orient[:-1]), ["malformed"], {}),
        ("only a type byte", slow.frame(ping[:1]), ["malformed"], {}),
        ("a count above its limit", slow.frame(orient[:7] + b"\x21" + bytes(33 * 7)), ["malformed"], {}),
        (
            "more data than a COMMAND may have",
            slow.frame(command[:-1] + b"\xc1" + bytes(193)),
            ["malformed"],
            {},
        ),
    ]
    return [stream(*case) for case in cases]


def stream(note: str, data: bytes, packets: list[str], counted: Mapping[str, int]) -> dict[str, Any]:
    """A case: what is found by hand here must agree with the slow readers of COBS and CRC."""
    counters = {"crc_errors": 0, "malformed": 0, "surplus_bytes": 0} | counted
    seen = {"crc_errors": 0, "malformed": 0}
    for coded in slow.frames_of(data):
        content = slow.content_of(coded)
        if content is None or not 3 <= len(content) <= slow.SCHEMA["wire"]["max_packet_bytes"] + 2:
            seen["malformed"] += 1
        elif slow.crc16(content[:-2]) != int.from_bytes(content[-2:], "little"):
            seen["crc_errors"] += 1
    assert counters | seen == counters, (note, seen)
    return {"note": note, "bytes": data.hex(), "packets": packets, **counters}


def flip(frame: bytes, at: int) -> bytes:
    """The frame with one bit changed in a byte that stays no delimiter."""
    changed = frame[at] ^ (0x10 if frame[at] != 0x10 else 0x20)
    return frame[:at] + bytes([changed]) + frame[at + 1 :]


if __name__ == "__main__":
    VECTORS.write_text(text(), encoding="utf-8")
