"""A second, slow reading of schema.toml: packets, quaternions, CRC and COBS in exact arithmetic.

It shares no code with the generator or with what that writes, so that their bytes can be checked against it.
"""

from __future__ import annotations

import itertools
import math
import struct
import tomllib
from collections.abc import Iterator, Mapping
from decimal import Decimal, getcontext
from pathlib import Path
from typing import Any

getcontext().prec = 60
ROOT_HALF = Decimal(1) / Decimal(2).sqrt()

PROTOCOL = Path(__file__).resolve().parents[2] / "protocol"
SCHEMA = tomllib.loads((PROTOCOL / "schema.toml").read_text())
PACKETS = {p["name"]: p for p in SCHEMA["packet"]}
RECORDS = {r["name"]: r for r in SCHEMA["record"]}
STRUCTS = {s["name"]: s for s in SCHEMA["struct"]}
QUATERNIONS = {f"smallest_three_{q['bits']}": q for q in SCHEMA["smallest_three"]}
# Two choices of codes whose squared errors, in steps, are closer than this count as equally good.
MARGIN = Decimal("0.005")


def pack(name: str, fields: Mapping[str, Any]) -> bytes:
    """Type byte and fields of a packet, or the fields of a record, from values as in vectors.json."""
    table = PACKETS.get(name) or RECORDS[name]
    head = bytes([table["id"]]) if "id" in table else b""
    return head + _pack_fields(table["fields"], fields)


def _pack_fields(rows: list[dict[str, Any]], fields: Mapping[str, Any]) -> bytes:
    out = b""
    for row in rows:
        value = fields[row["name"]]
        if "struct" in row:
            out += b"".join(_pack_fields(STRUCTS[row["struct"]]["fields"], item) for item in value)
        elif isinstance(value, str) and row["type"] == "u8":
            out += bytes.fromhex(value)
        elif row["type"] in QUATERNIONS:
            out += quaternion_bytes(row["type"], value)
        else:
            for one in value if isinstance(value, list) else [value]:
                out += _scalar(row, one)
    return out


def _scalar(row: Mapping[str, Any], value: Any) -> bytes:
    if row["type"] == "f32":
        return struct.pack("<f", float(value))
    if "scale" in row:
        value = row["invalid"] if value is None else round(Decimal(value) / Decimal(str(row["scale"])))
    bits = int(row["type"][1:])
    assert -(1 << bits) // 2 <= value < 1 << bits
    return bytes(value >> shift & 0xFF for shift in range(0, bits, 8))


def quaternion_bytes(kind: str, q: list[float] | None) -> bytes:
    """The bytes of a quaternion for which only one word is right; None: invalid."""
    (word,) = words(kind, q)
    return word.to_bytes(QUATERNIONS[kind]["word_bits"] // 8, "little")


def words(kind: str, q: list[float] | None) -> list[int]:
    """All words whose orientation is nearest to q, of any length; more than one if there is a tie."""
    table = QUATERNIONS[kind]
    levels = (1 << (table["bits"] - 1)) - 1
    if q is None:
        return [table.get("invalid", 0)]
    exact = [Decimal(c) for c in q]
    length = sum(c * c for c in exact).sqrt()
    index = max(range(4), key=lambda i: (abs(exact[i]), -i))
    unit = [c / length * (1 if exact[index] > 0 else -1) for c in exact]
    others = [unit[i] / ROOT_HALF * levels + levels for i in range(4) if i != index]
    ratios = [unit[i] / unit[index] for i in range(4) if i != index]
    found = []
    for codes in itertools.product(*((math.floor(x), math.floor(x) + 1) for x in others)):
        if max(codes) <= 2 * levels:
            errors = [code - x for code, x in zip(codes, others, strict=True)]
            share = sum(e * r for e, r in zip(errors, ratios, strict=True))
            found.append((sum(e * e for e in errors) + share * share, codes))
    least = min(cost for cost, _ in found)
    return sorted(join(kind, index, codes) for cost, codes in found if cost <= least + MARGIN)


def join(kind: str, index: int, codes: tuple[int, ...]) -> int:
    """The word of an index and three codes, marked valid."""
    table = QUATERNIONS[kind]
    word = index + sum(code << 2 + table["bits"] * k for k, code in enumerate(codes))
    return word + (1 << table["valid_bit"] if "valid_bit" in table else 0)


def quaternion(kind: str, word: int) -> list[float] | None:
    """What a word stands for; None if it is invalid."""
    table = QUATERNIONS[kind]
    if word == table.get("invalid") or ("valid_bit" in table and not word >> table["valid_bit"] & 1):
        return None
    levels = (1 << (table["bits"] - 1)) - 1
    codes = [(word >> 2 + table["bits"] * k) % (1 << table["bits"]) for k in range(3)]
    steps = [Decimal(code - levels) for code in codes]
    rest = 2 * levels * levels - sum(n * n for n in steps)
    if rest < 0:
        return None
    steps.insert(word % 4, rest.sqrt())
    return [float(n * ROOT_HALF / levels) for n in steps]


def crc16(data: bytes) -> int:
    """Bit by bit, by the numbers in the schema."""
    table = SCHEMA["framing"]["crc16"]
    crc = table["initial"]
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (table["polynomial"] if crc & 0x8000 else 0)) & 0xFFFF
    return crc ^ table["final_xor"]


def crc32(data: bytes) -> int:
    """Bit by bit, by the numbers in the schema, least significant bit first."""
    table = SCHEMA["framing"]["crc32"]
    polynomial = int(f"{table['polynomial']:032b}"[::-1], 2)
    crc = table["initial"]
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (polynomial if crc & 1 else 0)
    return crc ^ table["final_xor"]


def cobs(content: bytes) -> bytes:
    """By the definition: the content and a last zero, in blocks that end at a zero or after 254 others."""
    out, block, rest = b"", b"", content + b"\0"
    while rest:
        byte, rest = rest[:1], rest[1:]
        if byte == b"\0":
            out += bytes([len(block) + 1]) + block
            block = b""
        else:
            block += byte
            # A full block has no zero after it; the last zero, which is only meant, is then dropped.
            if len(block) == 254:
                out += b"\xff" + block
                block = b""
                rest = b"" if rest == b"\0" else rest
    return out


def frame(packet: bytes) -> bytes:
    """A whole frame with its delimiter."""
    return cobs(packet + crc16(packet).to_bytes(2, "little")) + b"\0"


def content_of(coded: bytes) -> bytes | None:
    """The inverse of `cobs`; None if a code byte points beyond the end."""
    out = b""
    while coded:
        code, block, rest = coded[0], coded[1 : coded[0]], coded[coded[0] :]
        if len(block) < code - 1:
            return None
        out += block + (b"\0" if code < 0xFF and rest else b"")
        coded = rest
    return out


def frames_of(stream: bytes) -> Iterator[bytes]:
    """What stands before each delimiter, empty ones left out."""
    yield from (coded for coded in stream.split(b"\0")[:-1] if coded)
