"""Writes the Python codec: enumerations, frozen dataclasses, encode and decode with NumPy for arrays."""

from __future__ import annotations

import textwrap
from pathlib import Path

from generator.python_codec import ARRAYS, codec, exploded, item_codec
from generator.schema import Choice, Field, Group, Schema, class_name

WIDTH = 110
PRELUDE = Path(__file__).with_name("prelude.py")

OPENING = '''\
# Generated from protocol/schema.toml by protocol/generate.py; change that and run it.
"""What goes over the wire between a ribbon and its host: packets as values, and their bytes.

An array of structures is a structure of NumPy arrays with a row for each item, which knows its count. Values
of an enumeration that this version does not know stay plain integers, flags it does not know are kept.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from operator import index
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
'''


def emit(schema: Schema) -> str:
    """The whole module."""
    messages = (*schema.records, *schema.packets)
    enums = {c.name for c in schema.enums}
    parts = [
        OPENING,
        PRELUDE.read_text(encoding="utf-8").partition("import numpy.typing as npt\n")[2],
        _constants(schema),
    ]
    parts.append(_enum("PacketId", "IntEnum", schema.packet_ids))
    parts.extend(_enum(class_name(c.name), "IntEnum", c) for c in schema.enums)
    parts.extend(_enum(class_name(c.name), "IntFlag", c) for c in schema.flags)
    parts.extend(_array_class(s) for s in schema.structs)
    parts.extend(_class(m, enums) for m in messages)
    parts.append("Packet = " + " | ".join(class_name(p.name) for p in schema.packets) + "\n")
    parts.append(SIGMA)
    parts.append(DISPATCH)
    parts.extend(item_codec(schema, s) for s in schema.structs)
    parts.extend(codec(m, enums) for m in messages)
    parts.append(_tables(schema))
    return "\n\n".join(part.strip("\n") + "\n" for part in parts)


SIGMA = '''
def sigma_rad(quality: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """Standard deviation of orientations, rad, largest axis, from quality bytes; NaN where unknown."""
    sigma: npt.NDArray[np.float64] = _SIGMA_RAD[np.asarray(quality) & 15]
    return sigma


def sigma_code(sigma_rad: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """The code, bits 0 to 3 of a quality byte, of standard deviations in rad; negative or NaN: unknown."""
    sigma = np.asarray(sigma_rad, np.float32)
    codes = np.minimum(np.searchsorted(_SIGMA_RAD[:-1].astype(np.float32), sigma), SIGMA_UNKNOWN - 1)
    return np.where(sigma >= 0, codes, SIGMA_UNKNOWN).astype(np.uint8)
'''

DISPATCH = '''
def encode(packet: Packet) -> bytes:
    """Type byte and fields. Raises WireError if a value does not fit in its field."""
    encoder = _ENCODERS.get(type(packet))
    if encoder is None:
        raise WireError(f"{packet!r} is not a packet.")
    return encoder(packet)


def decode(packet: bytes) -> tuple[Packet, int]:
    """The packet in these bytes, and how many surplus bytes follow the fields that this version knows.

    Raises UnknownPacketError for a type it does not know, and MalformedPacketError if the bytes end before
    their fields do or a count is above its limit; nothing else, whatever the bytes are.
    """
    if not packet:
        raise MalformedPacketError("A packet without a type byte.")
    decoder = _DECODERS.get(packet[0])
    if decoder is None:
        raise UnknownPacketError(f"A packet of type 0x{packet[0]:02x}, which this version does not know.")
    return decoder(packet)
'''


def _wrap(text: str, indent: str = "", hang: str = "") -> list[str]:
    return textwrap.wrap(
        text,
        WIDTH - 4,
        initial_indent=indent,
        subsequent_indent=indent + hang,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _constants(schema: Schema) -> str:
    lines = [
        f"WIRE_VERSION = {schema.version}",
        f"OLDEST_HOST_VERSION = {schema.oldest_host_version}",
        f"SCHEMA_HASH = 0x{schema.hash:08X}",
        f"MAX_PACKET_BYTES = {schema.max_packet_bytes}",
        *(f"{name.upper()} = {value}" for name, value in schema.limits.items()),
    ]
    for constant in schema.constants:
        number = f"0x{constant.value:X}" if constant.value > 0xFFFF else f"{constant.value}"
        lines += [*_wrap(constant.doc + ".", "# "), f"{constant.name.upper()} = {number}"]
    for group in (*schema.records, *schema.packets):
        for field in group.fields:
            if field.range is not None and not field.range_max_name:
                lines.append(f"{group.name.upper()}_{field.name.upper()}_RANGE = {field.range}")
    lines.append(f"SIGMA_UNKNOWN = {schema.sigma.unknown}")
    return "\n".join(lines)


def _enum(name: str, kind: str, choice: Choice) -> str:
    lines = [f"class {name}({kind}):", *_docstring(choice.doc, []), ""]
    for value in choice.values:
        lines += [*_wrap(value.doc, "    # "), f"    {value.name.upper()} = {value.value}"]
    return "\n".join(lines)


def _docstring(doc: str, attributes: list[str]) -> list[str]:
    first = _wrap(f'"""{doc}', "    ")
    if attributes:
        return [*first, "", *attributes, '    """']
    return [*first[:-1], f'{first[-1]}"""']


def _attribute(field: Field, shape: str) -> list[str]:
    facts = [fact for fact in (shape, field.unit, field.frame) if fact]
    if field.invalid is not None:
        facts.append("NaN: invalid" if field.scale is not None else f"{field.invalid}: invalid")
    text = f"{field.name}: {'; '.join([*facts, field.doc])}"
    return _wrap(text, "    ", "    ")


def _array_class(group: Group) -> str:
    attributes, members = [], []
    for field in group.fields:
        if field.is_smallest_three:
            attributes += _attribute(field, "(n, 4), NaN where not valid")
            attributes.append("    valid: (n,)")
            members += [f"    {field.name}: npt.NDArray[np.float64]", "    valid: npt.NDArray[np.bool_]"]
            continue
        attributes += _attribute(field, f"(n, {field.count})" if field.is_array else "(n,)")
        members.append(f"    {field.name}: npt.NDArray[np.{ARRAYS.get(field.type, 'int32')}]")
    return "\n".join(
        [
            "@dataclass(frozen=True, eq=False)",
            f"class {class_name(group.name)}Array:",
            *_docstring(f"{group.doc} One row each.", attributes),
            "",
            *members,
            "",
            "    def __len__(self) -> int:",
            f"        return len(self.{group.fields[0].name})",
        ]
    )


def _class(group: Group, enums: set[str]) -> str:
    cls = class_name(group.name)
    attributes, members, has_arrays = [], [], False
    for field in group.fields:
        if group.counts(field) is not None:
            continue
        has_arrays = has_arrays or field.is_struct
        attributes += _attribute(field, "")
        members.append(f"    {field.name}: {_annotation(field, enums)}")
        if field.is_variable and not field.is_struct and field is group.fields[-1]:
            members[-1] += ' = b""'
    lines = [
        f"@dataclass(frozen=True{', eq=False' if has_arrays else ''})",
        f"class {cls}:",
        *_docstring(group.doc, attributes),
        "",
        *members,
    ]
    if group.id is None:
        lines += [
            "",
            "    def pack(self) -> bytes:",
            '        """The bytes of the record. Raises WireError if a value does not fit in its field."""',
            f"        return _encode_{group.name}(self)",
            "",
            "    @staticmethod",
            f"    def unpack(record: bytes) -> {cls}:",
            '        """The record in these bytes.',
            "",
            "        Raises MalformedPacketError if they are too few or too many.",
            '        """',
            f"        {group.name}, surplus = _decode_{group.name}(record)",
            "        if surplus:",
            f'            raise MalformedPacketError(f"{cls} has {{surplus}} bytes too many.")',
            f"        return {group.name}",
        ]
    return "\n".join(lines)


def _annotation(field: Field, enums: set[str]) -> str:
    if field.is_struct:
        return f"{class_name(field.type)}Array"
    if field.is_array:
        return "bytes"
    if field.choice:
        return f"{class_name(field.choice)} | int" if field.choice in enums else class_name(field.choice)
    return "float" if field.type == "f32" or field.scale is not None else "int"


def _tables(schema: Schema) -> str:
    sigma = [f"{t:.9g}" for t in schema.sigma.thresholds_rad] + ["math.nan"]
    encoders = [f"{class_name(p.name)}: _encode_{p.name}" for p in schema.packets]
    decoders = [f"PacketId.{p.name.upper()}: _decode_{p.name}" for p in schema.packets]
    return "\n".join(
        [
            "_SIGMA_RAD = np.array(",
            *exploded("    [", sigma, "]"),
            ")",
            *exploded("_ENCODERS: dict[type, Callable[[Any], bytes]] = {", encoders, "}"),
            *exploded("_DECODERS: dict[int, Callable[[bytes], tuple[Packet, int]]] = {", decoders, "}"),
        ]
    )
