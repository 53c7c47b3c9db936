"""Reads schema.toml, checking each rule that the generated code rests on."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from typing import Any

from generator.errors import SchemaError
from generator.names import check_names, check_unique
from generator.schema import (
    INTEGER_BYTES,
    Choice,
    Field,
    Group,
    Schema,
    SigmaCode,
    SmallestThree,
    Value,
    layout_hash,
)

FIELD_KEYS = frozenset(
    ["name", "type", "struct", "count", "enum", "flags", "scale", "invalid", "range", "unit", "frame", "doc"]
)


def load(text: str) -> Schema:
    """The schema in a TOML text. Raises SchemaError with one sentence if it breaks a rule."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SchemaError(f"schema.toml is not TOML: {error}.") from None
    try:
        return _schema(tables)
    except KeyError as error:
        raise SchemaError(f"A table of schema.toml lacks {error}: add it.") from None
    except (TypeError, ValueError, AttributeError) as error:
        raise SchemaError(f"A table of schema.toml holds a value of the wrong kind: {error}.") from None


def _schema(tables: Mapping[str, Any]) -> Schema:
    wire = tables["wire"]
    limits = {name: wire[name] for name in ("node_max", "slot_max")}
    enums = tuple(_choice(name, t["doc"], t["values"], "value") for name, t in tables["enum"].items())
    flags = tuple(_choice(name, t["doc"], t["bits"], "bit") for name, t in tables["flags"].items())
    quaternions = tuple(_smallest_three(t) for t in tables["smallest_three"])
    reader = _GroupReader(limits, enums, flags, quaternions)
    structs = []
    for table in tables["struct"]:
        structs.append(reader.group(table, in_array=True))
        reader.struct_bytes[structs[-1].name] = table["bytes"]
    records = tuple(reader.group(t) for t in tables["record"])
    packets = tuple(reader.group(t, packet=True) for t in tables["packet"])
    _check_packets(packets, wire["max_packet_bytes"])
    sigma = _sigma(tables["sigma_code"])
    schema = Schema(
        version=wire["version"],
        oldest_host_version=wire["oldest_host_version"],
        max_packet_bytes=wire["max_packet_bytes"],
        limits=limits,
        framing=tables["framing"],
        constants=tuple(Value(c["name"], c["value"], c["doc"]) for c in tables["constant"]),
        enums=enums,
        flags=flags,
        sigma=sigma,
        smallest_three=quaternions,
        structs=tuple(structs),
        records=records,
        packets=packets,
        hash=layout_hash(enums, flags, sigma, quaternions, (*structs, *records, *packets)),
    )
    check_names(schema)
    return schema


def _choice(name: str, doc: str, rows: Iterable[Mapping[str, Any]], key: str) -> Choice:
    values = []
    for row in rows:
        number = row[key]
        if not 0 <= number <= (255 if key == "value" else 7):
            raise SchemaError(f"{name}.{row['name']} has {key} {number}, which does not fit in a byte.")
        values.append(Value(row["name"], number if key == "value" else 1 << number, row["doc"]))
    check_unique((v.name for v in values), f"name in {name}")
    check_unique((v.value for v in values), f"{key} in {name}")
    return Choice(name, tuple(values), doc)


def _smallest_three(table: Mapping[str, Any]) -> SmallestThree:
    q = SmallestThree(table["bits"], table["word_bits"], table.get("valid_bit"), table.get("invalid"))
    used = 2 + 3 * q.bits
    if (q.valid_bit is None) == (q.invalid is None):
        raise SchemaError(
            f"{q.type} needs either a valid_bit or an invalid word, to tell valid from invalid."
        )
    if q.word_bits % 8 or q.word_bits > 64 or used + (q.valid_bit is not None) > q.word_bits:
        raise SchemaError(f"{q.type} does not fit in {q.word_bits} bits: use whole bytes, at most 64 bits.")
    if q.valid_bit is not None and not used <= q.valid_bit < q.word_bits:
        raise SchemaError(f"{q.type} has its valid_bit {q.valid_bit} outside the free bits of its word.")
    if q.invalid is not None and q.invalid != (1 << q.word_bits) - 1:
        raise SchemaError(
            f"{q.type} must have the invalid word of all ones, the only one that is never a code."
        )
    return q


def _sigma(table: Mapping[str, Any]) -> SigmaCode:
    threshold, thresholds = table["smallest_rad"], []
    for _ in range(table["unknown"]):
        thresholds.append(threshold)
        threshold *= table["ratio"]
    return SigmaCode(table["doc"], tuple(thresholds), table["unknown"])


class _GroupReader:
    """Turns tables of fields into groups, checking them against what was defined before."""

    def __init__(
        self,
        limits: Mapping[str, int],
        enums: Iterable[Choice],
        flags: Iterable[Choice],
        quaternions: Iterable[SmallestThree],
    ) -> None:
        self._limits = limits
        self._choices = {"enum": {c.name for c in enums}, "flags": {c.name for c in flags}}
        self._bytes = INTEGER_BYTES | {"f32": 4} | {q.type: q.word_bytes for q in quaternions}
        self.struct_bytes: dict[str, int] = {}

    def group(self, table: Mapping[str, Any], *, in_array: bool = False, packet: bool = False) -> Group:
        fields: list[Field] = []
        for row in table["fields"]:
            fields.append(self._field(row, f"{table['name']}.{row['name']}", fields, in_array))
        check_unique((f.name for f in fields), f"field in {table['name']}")
        for field in fields:
            if field.is_smallest_three and any(f.name == "valid" for f in fields):
                raise SchemaError(
                    f"{table['name']}.valid collides with the validity of {field.name}: rename it."
                )
        group = Group(
            name=table["name"],
            id=table["id"] if packet else None,
            sender=table["from"] if packet else "",
            fields=tuple(fields),
            doc=table["doc"],
        )
        if in_array and group.fixed_bytes != table["bytes"]:
            raise SchemaError(
                f"{group.name} has bytes = {table['bytes']}, but its fields take {group.fixed_bytes}: "
                "a structure that was released never changes size, define a new one."
            )
        return group

    def _field(self, row: Mapping[str, Any], where: str, before: list[Field], in_array: bool) -> Field:
        if not row.keys() <= FIELD_KEYS:
            unknown = ", ".join(sorted(row.keys() - FIELD_KEYS))
            raise SchemaError(
                f"{where} has {unknown}, which means nothing: use {', '.join(sorted(FIELD_KEYS))}."
            )
        count = row.get("count", 1)
        if "struct" in row:
            if "type" in row:
                raise SchemaError(f"{where} has a type and a structure: remove one of them.")
            if row["struct"] not in self.struct_bytes:
                raise SchemaError(
                    f"{where} has the structure {row['struct']}, which is not defined before it."
                )
            if in_array or not isinstance(count, str):
                raise SchemaError(
                    f"{where}: structures stand only in arrays of a packet or record, with a count."
                )
            kind, size = row["struct"], self.struct_bytes[row["struct"]]
        else:
            kind = row["type"]
            if kind not in self._bytes:
                known = ", ".join(self._bytes)
                raise SchemaError(f"{where} has the unknown type {kind}: use one of {known}.")
            size = self._bytes[kind]
            if count != 1 and not in_array and kind != "u8":
                raise SchemaError(
                    f"{where}: outside a structure only u8 may be an array, define a structure."
                )
            if not in_array and (kind == "i24" or kind.startswith("smallest_three_")):
                raise SchemaError(f"{where}: {kind} is only for structures.")
            if kind.startswith("smallest_three_") and count != 1:
                raise SchemaError(f"{where}: a structure holds one quaternion, not an array of them.")
        if isinstance(count, str):
            self._check_counter(count, where, before, in_array)
        elif not 1 <= count <= 255:
            raise SchemaError(f"{where} has the count {count}: use 1 to 255 or the name of a field.")
        high_name = ""
        value_range = row.get("range")
        if value_range is not None:
            low, high = value_range
            if isinstance(high, str):
                if high not in self._limits:
                    raise SchemaError(f"{where} has the range end {high}, which [wire] does not define.")
                high_name, high = high, self._limits[high]
            value_range = (low, high)
        field = Field(
            name=row["name"],
            type=kind,
            is_struct="struct" in row,
            count=count,
            bytes=size,
            choice=row.get("enum", row.get("flags", "")),
            scale=row.get("scale"),
            invalid=row.get("invalid"),
            range=value_range,
            range_max_name=high_name,
            unit=row.get("unit", ""),
            frame=row.get("frame", ""),
            doc=row["doc"],
        )
        self._check_meaning(field, row, where, in_array)
        return field

    def _check_counter(self, count: str, where: str, before: list[Field], in_array: bool) -> None:
        counter = next((f for f in before if f.name == count), None)
        if in_array:
            raise SchemaError(f"{where}: a structure has a fixed size, give a number as count.")
        if counter is None:
            raise SchemaError(f"{where} is counted by {count}, which is not a field before it.")
        if any(f.count == count for f in before):
            raise SchemaError(f"{where} is counted by {count}, which counts another array already.")
        if counter.type != "u8" or counter.is_array or counter.range is None or counter.range[0] != 0:
            raise SchemaError(f"{where} is counted by {count}, which must be one u8 with a range from 0.")

    def _check_meaning(self, field: Field, row: Mapping[str, Any], where: str, in_array: bool) -> None:
        for key in ("enum", "flags"):
            if key in row and (row[key] not in self._choices[key] or field.type != "u8" or field.is_array):
                raise SchemaError(f"{where}: {key} {row[key]} must be defined, and the field one u8.")
        if field.scale is not None:
            if in_array or field.is_array or field.type not in ("u8", "u16", "i8", "i16"):
                raise SchemaError(
                    f"{where}: a scale is for one integer of at most 16 bits outside a structure."
                )
            if field.scale <= 0 or field.invalid not in field.limits:
                raise SchemaError(
                    f"{where} needs a scale above 0 and its type's first or last value as invalid."
                )
        if field.range is not None and field.type in INTEGER_BYTES and field.scale is None:
            low, high = field.limits
            if not low <= field.range[0] <= field.range[1] <= high:
                raise SchemaError(
                    f"{where} has the range {list(field.range)}, which {field.type} cannot hold."
                )


def _check_packets(packets: tuple[Group, ...], max_bytes: int) -> None:
    check_unique((p.id for p in packets), "packet id")
    for packet in packets:
        if packet.id is None or not 1 <= packet.id <= 255:
            raise SchemaError(f"Packet {packet.name} has the id {packet.id}: use 1 to 255, 0 is reserved.")
        if packet.max_bytes > max_bytes:
            raise SchemaError(
                f"Packet {packet.name} can be {packet.max_bytes} bytes long, more than the {max_bytes} of "
                "max_packet_bytes: raise that or lower a count."
            )
        if packet.sender not in ("device", "host"):
            raise SchemaError(f"Packet {packet.name} is from {packet.sender}: use device or host.")
