"""Checks that no two names of the schema become one name in C or in Python."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from generator.errors import SchemaError
from generator.schema import Schema, class_name

NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
C_KEYWORDS = frozenset(
    re.findall(
        "[a-z]+",
        """auto break case char const continue default do double else enum extern float for goto if inline int
        long register restrict return short signed sizeof static struct switch typedef union unsigned void
        volatile while bool true false""",
    )
)
# Names that generated functions and classes use themselves.
RESERVED_NAMES = frozenset(
    re.findall("[a-z]+", "octets at end rows words pieces reader item out size whole valid pack unpack")
)


def check_names(schema: Schema) -> None:
    """Raises SchemaError at the first name that is no name, or that two things have."""
    groups = (*schema.structs, *schema.records, *schema.packets)
    choices = (*schema.enums, *schema.flags)
    members = [v.name for c in choices for v in c.values] + [f.name for g in groups for f in g.fields]
    things = [g.name for g in groups] + [c.name for c in choices] + [c.name for c in schema.constants]
    for name in [*things, *members]:
        if not NAME.fullmatch(name) or keyword.iskeyword(name) or name in C_KEYWORDS:
            raise SchemaError(f"The name {name} must be lower case with single underscores, and no keyword.")
        if name in RESERVED_NAMES:
            raise SchemaError(f"The name {name} is taken by the generated code: choose another.")
    check_unique(_c_names(schema), "name in C")
    check_unique(_python_names(schema), "name in Python")


def check_unique(items: Iterable[object], what: str) -> None:
    """Raises SchemaError if an item comes twice."""
    seen = set()
    for item in items:
        if item in seen:
            raise SchemaError(f"Two have the same {what}, {item}: change one of them.")
        seen.add(item)


def _c_names(schema: Schema) -> Iterator[str]:
    yield from ("WIRE_VERSION", "WIRE_OLDEST_HOST_VERSION", "WIRE_SCHEMA_HASH", "WIRE_MAX_PACKET_BYTES")
    yield from ("WIRE_ERROR_TRUNCATED", "WIRE_ERROR_COUNT", "WIRE_ERROR_TYPE", "wire_sigma_code")
    yield from re.findall(r"^(?:static inline [^(]*?|struct )(wire_\w+)", _prelude("prelude.h"), re.MULTILINE)
    yield from (f"WIRE_{name.upper()}" for name in (*schema.limits, *(c.name for c in schema.constants)))
    for choice in (schema.packet_ids, *schema.enums, *schema.flags):
        yield f"wire_{choice.name}"
        yield from (f"WIRE_{choice.name}_{v.name}".upper() for v in choice.values)
    for q in schema.smallest_three:
        yield from (f"wire_put_{q.type}", f"wire_get_{q.type}")
    for group in (*schema.structs, *schema.records, *schema.packets):
        yield f"wire_{group.name}"
        if group in schema.structs:
            yield from (
                f"wire_put_{group.name}",
                f"wire_get_{group.name}",
                f"WIRE_{group.name}_BYTES".upper(),
            )
            continue
        yield from (f"wire_{group.name}_pack", f"wire_{group.name}_unpack")
        yield from (f"WIRE_{group.name}_{end}_BYTES".upper() for end in ("min", "max"))
        ranged = [f for f in group.fields if f.range is not None]
        yield from (f"WIRE_{group.name}_{f.name}_{end}".upper() for f in ranged for end in ("min", "max"))


def _python_names(schema: Schema) -> Iterator[str]:
    yield from ("WIRE_VERSION", "OLDEST_HOST_VERSION", "SCHEMA_HASH", "MAX_PACKET_BYTES", "SIGMA_UNKNOWN")
    yield from ("Packet", "PacketId", "encode", "decode", "sigma_rad", "sigma_code", "Any", "Callable")
    yield from re.findall(r"^(?:def |class )?(\w+)(?: =|\()", _prelude("prelude.py"), re.MULTILINE)
    yield from (name.upper() for name in (*schema.limits, *(c.name for c in schema.constants)))
    yield from (class_name(c.name) for c in (*schema.enums, *schema.flags))
    for group in schema.structs:
        yield f"{class_name(group.name)}Array"
    for group in (*schema.records, *schema.packets):
        yield class_name(group.name)
        yield from (f"{group.name}_{f.name}_RANGE".upper() for f in group.fields if f.range is not None)


def _prelude(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")
