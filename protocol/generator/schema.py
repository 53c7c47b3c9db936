"""What schema.toml says, as values, and the hash of the layout they describe."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

INTEGER_BYTES = {"u8": 1, "u16": 2, "u32": 4, "u64": 8, "i8": 1, "i16": 2, "i24": 3, "i32": 4}


@dataclass(frozen=True)
class Value:
    """A named number: a constant, a value of an enumeration, or the bit of a flag."""

    name: str
    value: int
    doc: str


@dataclass(frozen=True)
class Choice:
    """An enumeration, or a set of flags whose values are bit masks."""

    name: str
    values: tuple[Value, ...]
    doc: str


@dataclass(frozen=True)
class SmallestThree:
    """A quaternion type: index of the largest component (2 bits), then three components of `bits` each.

    Either `valid_bit` is set when the quaternion is valid, or the word is `invalid` when it is not.
    """

    bits: int
    word_bits: int
    valid_bit: int | None
    invalid: int | None

    @property
    def type(self) -> str:
        return f"smallest_three_{self.bits}"

    @property
    def word_bytes(self) -> int:
        return self.word_bits // 8

    @property
    def levels(self) -> int:
        """Codes on either side of zero."""
        return (1 << (self.bits - 1)) - 1


@dataclass(frozen=True)
class SigmaCode:
    """Thresholds of a quality byte's standard deviation; the last code means unknown."""

    doc: str
    thresholds_rad: tuple[float, ...]
    unknown: int


@dataclass(frozen=True)
class Field:
    """One field: `count` is 1, a fixed number, or the name of the field that holds it."""

    name: str
    type: str
    is_struct: bool
    count: int | str
    bytes: int
    choice: str
    scale: float | None
    invalid: int | None
    range: tuple[float, float] | None
    range_max_name: str
    unit: str
    frame: str
    doc: str

    @property
    def is_variable(self) -> bool:
        return isinstance(self.count, str)

    @property
    def is_array(self) -> bool:
        return self.count != 1

    @property
    def is_smallest_three(self) -> bool:
        return self.type.startswith("smallest_three_")

    @property
    def limits(self) -> tuple[int, int]:
        """Smallest and largest number that the bytes of an integer type hold."""
        bits = 8 * INTEGER_BYTES[self.type]
        return (0, (1 << bits) - 1) if self.type[0] == "u" else (-(1 << (bits - 1)), (1 << (bits - 1)) - 1)

    @property
    def scaled_limits(self) -> tuple[int, int]:
        """Like `limits`, without the number that means invalid."""
        low, high = self.limits
        return (low + 1, high) if self.invalid == low else (low, high - 1)


@dataclass(frozen=True)
class Group:
    """A packet (with an id), a record, or a structure (both without)."""

    name: str
    id: int | None
    sender: str
    fields: tuple[Field, ...]
    doc: str

    @property
    def fixed_bytes(self) -> int:
        """Bytes with nothing in the variable arrays, including a packet's type byte."""
        fixed = sum(f.bytes * f.count for f in self.fields if isinstance(f.count, int))
        return fixed + (self.id is not None)

    @property
    def max_bytes(self) -> int:
        return self.fixed_bytes + sum(f.bytes * self.capacity(f) for f in self.fields if f.is_variable)

    def capacity(self, field: Field) -> int:
        """Largest number of elements of an array."""
        if isinstance(field.count, int):
            return field.count
        counter = self.counter(field)
        assert counter.range is not None
        return int(counter.range[1])

    def counter(self, field: Field) -> Field:
        """The field that holds the count of a variable array."""
        return next(f for f in self.fields if f.name == field.count)

    def counts(self, field: Field) -> Field | None:
        """The first variable array whose count this field holds, if any."""
        return next((f for f in self.fields if f.count == field.name), None)


@dataclass(frozen=True)
class Schema:
    """Everything that schema.toml says; `hash` is that of the layout alone."""

    version: int
    oldest_host_version: int
    max_packet_bytes: int
    limits: Mapping[str, int]
    framing: Mapping[str, Any]
    constants: tuple[Value, ...]
    enums: tuple[Choice, ...]
    flags: tuple[Choice, ...]
    sigma: SigmaCode
    smallest_three: tuple[SmallestThree, ...]
    structs: tuple[Group, ...]
    records: tuple[Group, ...]
    packets: tuple[Group, ...]
    hash: int

    @property
    def packet_ids(self) -> Choice:
        """The packet types as an enumeration."""
        values = tuple(Value(p.name, p.id, p.doc) for p in self.packets if p.id is not None)
        return Choice("packet", values, "Type byte of a packet.")


def class_name(name: str) -> str:
    """The Python class of a snake_case name."""
    return "".join(part.capitalize() for part in name.split("_"))


def layout_hash(
    enums: Iterable[Choice],
    flags: Iterable[Choice],
    sigma: SigmaCode,
    quaternions: Iterable[SmallestThree],
    groups: Iterable[Group],
) -> int:
    """First four bytes, little-endian, of the SHA-256 of all that decides what bytes mean, and no prose."""
    lines = [
        f"{kind} {c.name} " + " ".join(f"{v.name}={v.value}" for v in c.values)
        for kind, choices in (("enum", enums), ("flags", flags))
        for c in choices
    ]
    lines.append(
        "sigma_code " + " ".join(f"{t:.9g}" for t in sigma.thresholds_rad) + f" unknown={sigma.unknown}"
    )
    lines.extend(f"{q.type} {q.word_bits} {q.valid_bit} {q.invalid}" for q in quaternions)
    for group in groups:
        lines.append(f"group {group.name} {group.id} {group.sender}")
        lines.extend(f"{f.name} {f.type} {f.count} {f.choice} {f.scale} {f.invalid}" for f in group.fields)
    digest = hashlib.sha256("\n".join(lines).encode()).digest()
    return int.from_bytes(digest[:4], "little")
