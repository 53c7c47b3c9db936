"""Writes the tables of PROTOCOL.md, each between a begin and an end marker of its own."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from generator.errors import SchemaError
from generator.schema import Choice, Field, Group, Schema

MARKER = re.compile(r"<!-- (begin|end): (\w+) -->")


def emit(schema: Schema, text: str) -> str:
    """`text` with all tables as the schema says.

    Raises SchemaError if a table is not there exactly once, or there is one that the schema does not know.
    """
    tables = dict(_tables(schema))
    found = [match.groups() for match in MARKER.finditer(text)]
    expected = [(side, name) for side, name in found if side == "begin" for side in ("begin", "end")]
    if found != expected:
        raise SchemaError(
            "PROTOCOL.md has a begin marker without its end, or the other way round: pair them."
        )
    names = [name for side, name in found if side == "begin"]
    for name in names:
        if name not in tables or names.count(name) > 1:
            raise SchemaError(f"PROTOCOL.md has a table {name} too many: remove its markers.")
    for name, table in tables.items():
        begin, end = f"<!-- begin: {name} -->", f"<!-- end: {name} -->"
        if name not in names:
            raise SchemaError(f"PROTOCOL.md lacks the table {name}: add the lines {begin} and {end}.")
        head, _, rest = text.partition(begin)
        text = f"{head}{begin}\n{table}\n{end}{rest.partition(end)[2]}"
    return text


def _tables(schema: Schema) -> Iterator[tuple[str, str]]:
    yield "constants", _constants(schema)
    for choice in schema.enums:
        yield choice.name, _choice(choice, "value", [f"{v.value}" for v in choice.values])
    for choice in schema.flags:
        yield choice.name, _choice(choice, "bit", [f"{v.value.bit_length() - 1}" for v in choice.values])
    for group in (*schema.records, *schema.packets):
        yield group.name, _group(schema, group)


def _constants(schema: Schema) -> str:
    rows = [
        ("wire version", f"{schema.version}", "`INFO.wire_version`"),
        ("oldest host version", f"{schema.oldest_host_version}", "`INFO.oldest_host_version`"),
        ("schema hash", f"0x{schema.hash:08X}", "`INFO.schema_hash`"),
        ("largest packet", f"{schema.max_packet_bytes} bytes", "type byte and fields"),
        ("node_max", f"{schema.limits['node_max']}", "nodes in a packet"),
        ("slot_max", f"{schema.limits['slot_max']}", "slots in a packet"),
    ]
    rows += [
        (c.name, f"{c.value}" + (f" (0x{c.value:X})" if c.value > 0xFFFF else ""), c.doc)
        for c in schema.constants
    ]
    return _table(("constant", "value", "meaning"), rows)


def _choice(choice: Choice, key: str, numbers: Sequence[str]) -> str:
    rows = [(number, f"`{v.name}`", v.doc) for number, v in zip(numbers, choice.values, strict=True)]
    return f"`{choice.name}`: {choice.doc}\n\n" + _table((key, "name", "meaning"), rows)


def _group(schema: Schema, group: Group) -> str:
    rows: list[tuple[str, ...]] = []
    length = f"{group.fixed_bytes}"
    for field in group.fields:
        if field.is_variable:
            length += f" + {f'{field.bytes} ' if field.bytes > 1 else ''}{field.count}"
    length += " bytes" if length == f"{group.fixed_bytes}" else f" bytes, at most {group.max_bytes}"
    if group.id is None:
        head = f"{group.doc} {length}."
        offset = 0
    else:
        head = f"{group.doc} Type 0x{group.id:02x}, from the {group.sender}, {length}."
        rows.append(("0", "type", "`u8`", "", f"0x{group.id:02x}"))
        offset = 1
    parts = [head, ""]
    rows += _rows(group.fields, offset)
    parts.append(_table(("offset", "field", "type", "unit, frame", "meaning"), rows))
    for struct in schema.structs:
        if any(field.type == struct.name for field in group.fields):
            parts += ["", f"Each `{struct.name}`, {struct.fixed_bytes} bytes: {struct.doc}", ""]
            parts.append(
                _table(("offset", "field", "type", "unit, frame", "meaning"), _rows(struct.fields, 0))
            )
    return "\n".join(parts)


def _rows(fields: Sequence[Field], offset: int) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for k, field in enumerate(fields):
        after_array = any(f.is_variable for f in fields[:k])
        kind = f"{field.type} x {field.count}" if field.is_array else field.type
        unit = ", ".join(part for part in (field.unit, field.frame) if part)
        rows.append(("..." if after_array else f"{offset}", field.name, f"`{kind}`", unit, _meaning(field)))
        offset += field.bytes * (field.count if isinstance(field.count, int) else 0)
    return rows


def _meaning(field: Field) -> str:
    text = field.doc
    if field.choice:
        text += f" (`{field.choice}`)"
    if field.scale is not None:
        text += f"; in steps of {field.scale:g}"
    if field.range is not None:
        low, high = (f"{limit:g}" for limit in field.range)
        text += f"; {low} to {high}"
    if field.invalid is not None and field.scale is not None:
        text += f"; {field.invalid} if there is none"
    return text


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
