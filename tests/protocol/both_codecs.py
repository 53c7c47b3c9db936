"""The C and the Python codec behind one face: values as in vectors.json in, bytes out, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import slow_packer as slow
from ribbonhil._firmware import ffi, lib
from ribbonhost import wire

Fields = dict[str, Any]
CAPACITY = 4096


def rows_of(name: str) -> list[dict[str, Any]]:
    """The fields of a packet, record or structure, as the schema has them."""
    return list((slow.PACKETS.get(name) or slow.RECORDS.get(name) or slow.STRUCTS[name])["fields"])


def is_counter(name: str, row: Mapping[str, Any]) -> bool:
    """Whether this field is the count of another."""
    return any(other.get("count") == row["name"] for other in rows_of(name))


def class_of(name: str, suffix: str = "") -> Any:
    """The class of a message or, with a suffix, of an array of structures."""
    return getattr(wire, "".join(part.capitalize() for part in name.split("_")) + suffix)


# ---------------------------------------------------------------- Python


def python_value(name: str, fields: Mapping[str, Any]) -> Any:
    """The dataclass with these values."""
    arguments: Fields = {}
    for row in rows_of(name):
        value = fields[row["name"]]
        if is_counter(name, row):
            continue
        if "struct" in row:
            value = _python_array(row["struct"], value)
        elif row["type"] == "u8" and "count" in row:
            value = bytes.fromhex(value)
        elif value is None:
            value = math.nan
        arguments[row["name"]] = value
    return class_of(name)(**arguments)


def _python_array(struct_name: str, items: list[Fields]) -> Any:
    arguments: Fields = {}
    for row in rows_of(struct_name):
        column = [item[row["name"]] for item in items]
        if row["type"] in slow.QUATERNIONS:
            arguments["valid"] = np.array([q is not None for q in column], bool)
            quaternions = [[math.nan] * 4 if q is None else q for q in column]
            arguments[row["name"]] = np.array(quaternions, float).reshape(-1, 4)
            continue
        kind = np.float64 if row["type"] == "f32" else np.int64
        shape = (len(items), row["count"]) if "count" in row else (len(items),)
        arguments[row["name"]] = np.array(column, kind).reshape(shape)
    return class_of(struct_name, "Array")(**arguments)


def python_fields(name: str, value: Any) -> Fields:
    """The values of a dataclass."""
    fields: Fields = {}
    for row in rows_of(name):
        if is_counter(name, row):
            counted = next(r["name"] for r in rows_of(name) if r.get("count") == row["name"])
            fields[row["name"]] = len(getattr(value, counted))
            continue
        member = getattr(value, row["name"])
        if "struct" in row:
            fields[row["name"]] = _array_fields(row["struct"], member)
        elif isinstance(member, bytes):
            fields[row["name"]] = member.hex()
        elif "scale" in row:
            fields[row["name"]] = None if math.isnan(member) else member
        else:
            fields[row["name"]] = member if row["type"] == "f32" else int(member)
    return fields


def _array_fields(struct_name: str, array: Any) -> list[Fields]:
    columns = {row["name"]: getattr(array, row["name"]).tolist() for row in rows_of(struct_name)}
    for row in rows_of(struct_name):
        if row["type"] in slow.QUATERNIONS:
            pairs = zip(columns[row["name"]], array.valid, strict=True)
            columns[row["name"]] = [q if valid else None for q, valid in pairs]
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def python_pack(name: str, fields: Mapping[str, Any]) -> bytes:
    """Bytes from the Python codec."""
    value = python_value(name, fields)
    packed: bytes = value.pack() if name in slow.RECORDS else wire.encode(value)
    return packed


def python_unpack(name: str, data: bytes) -> tuple[Fields, int]:
    """(values, surplus bytes) from the Python codec. Raises wire.WireError."""
    if name in slow.RECORDS:
        return python_fields(name, class_of(name).unpack(data)), 0
    value, surplus = wire.decode(data)
    assert type(value) is class_of(name)
    return python_fields(name, value), surplus


# ---------------------------------------------------------------- C


def c_value(name: str, fields: Mapping[str, Any]) -> Any:
    """The C structure with these values."""
    value = ffi.new(f"struct wire_{name} *")
    _fill(name, value, fields)
    return value


def _fill(name: str, target: Any, fields: Mapping[str, Any]) -> None:
    for row in rows_of(name):
        value, member = fields[row["name"]], row["name"]
        if "struct" in row:
            for item, values in zip(getattr(target, member), value, strict=False):
                _fill(row["struct"], item, values)
        elif row["type"] in slow.QUATERNIONS:
            setattr(target, f"{member}_valid", value is not None)
            setattr(target, member, [0.0] * 4 if value is None else [float(c) for c in value])
        elif row["type"] == "u8" and "count" in row:
            octets = bytes.fromhex(value)
            ffi.buffer(getattr(target, member))[: len(octets)] = octets
        else:
            setattr(target, member, math.nan if value is None else value)


def c_fields(name: str, source: Any) -> Fields:
    """The values of a C structure."""
    fields: Fields = {}
    for row in rows_of(name):
        member = getattr(source, row["name"])
        count = fields[row["count"]] if isinstance(row.get("count"), str) else row.get("count")
        if "struct" in row:
            fields[row["name"]] = [c_fields(row["struct"], member[i]) for i in range(count)]
        elif row["type"] in slow.QUATERNIONS:
            fields[row["name"]] = list(member) if getattr(source, f"{row['name']}_valid") else None
        elif row["type"] == "u8" and count is not None:
            fields[row["name"]] = bytes(member)[:count].hex()
        elif count is not None:
            fields[row["name"]] = list(member)
        else:
            fields[row["name"]] = None if "scale" in row and math.isnan(member) else member
    return fields


def c_pack(name: str, fields: Mapping[str, Any], capacity: int = CAPACITY) -> bytes:
    """Bytes from the C codec; none if it refused."""
    out = ffi.new("uint8_t[]", CAPACITY)
    n = getattr(lib, f"wire_{name}_pack")(c_value(name, fields), out, capacity)
    return bytes(ffi.buffer(out, n))


def c_unpack(name: str, data: bytes) -> tuple[Fields, int]:
    """(values, bytes used) from the C codec; no values and WIRE_ERROR_* if there was an error."""
    value = ffi.new(f"struct wire_{name} *")
    used = getattr(lib, f"wire_{name}_unpack")(data, len(data), value)
    return ({} if used < 0 else c_fields(name, value)), used


# ---------------------------------------------------------------- comparison


def assert_same(name: str, one: Mapping[str, Any], other: Mapping[str, Any]) -> None:
    """Fails unless the values agree: quaternions and scaled ones to single precision, others exactly."""
    assert one.keys() == other.keys()
    for row in rows_of(name):
        a, b = one[row["name"]], other[row["name"]]
        where = f"{name}.{row['name']}: {a} and {b}"
        if "struct" in row:
            assert len(a) == len(b), where
            for x, y in zip(a, b, strict=True):
                assert_same(row["struct"], x, y)
        elif row["type"] in slow.QUATERNIONS or "scale" in row:
            assert (a is None) == (b is None), where
            assert a is None or np.allclose(a, b, rtol=1e-6, atol=1e-6), where
        elif row["type"] == "f32":
            assert np.array_equal(np.float32(a), np.float32(b), equal_nan=True), where
        else:
            assert a == b, where
