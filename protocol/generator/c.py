"""Writes the C header: constants, structures, pack and unpack as static inline functions."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from math import degrees
from pathlib import Path

from generator.c_codec import TYPES, WIDTH, get_struct, pack, put_struct, quaternion, unpack
from generator.schema import Choice, Field, Group, Schema

PRELUDE = Path(__file__).with_name("prelude.h")

OPENING = """\
/* Generated from protocol/schema.toml by protocol/generate.py; change that and run it. */

/* What goes over the wire between a ribbon and its host: values, and their bytes.
 *
 * wire_X_pack writes packet X (its type byte first) and returns how many bytes that took; 0, with nothing
 * written, if it does not fit in `capacity` or a count is above its limit.
 * wire_X_unpack reads it and returns how many bytes it used; bytes after those are fields that a newer
 * device appended. Or it returns a negative WIRE_ERROR_*; fields beyond the end of the packet are zero then.
 * Both are the same for a record, which has no type byte. A quaternion that is not valid, or cannot be
 * normalised, is packed as invalid and unpacked as NaN. Integers of 24 bits and scaled numbers saturate. */
#ifndef WIRE_H
#define WIRE_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
"""

ERRORS = """\
#define WIRE_ERROR_TRUNCATED (-1) /* shorter than its fields say */
#define WIRE_ERROR_COUNT     (-2) /* a count is above its limit */
#define WIRE_ERROR_TYPE      (-3) /* the type byte of another packet */
"""


def emit(schema: Schema) -> str:
    """The whole header."""
    parts: list[str] = [OPENING, _constants(schema), ERRORS]
    parts.extend(_enum(choice) for choice in (schema.packet_ids, *schema.enums, *schema.flags))
    parts.append(_sizes(schema))
    parts.extend(_struct(group) for group in (*schema.structs, *schema.records, *schema.packets))
    parts.append(_sigma_code(schema))
    parts.append(PRELUDE.read_text(encoding="utf-8").split("\n\n", 1)[1])
    parts.extend(quaternion(q) for q in schema.smallest_three)
    for group in schema.structs:
        parts.extend((put_struct(group), get_struct(group)))
    for group in (*schema.records, *schema.packets):
        parts.extend((pack(group), unpack(group)))
    return "\n".join(parts) + "\n#endif\n"


def _comment(text: str, indent: str = "") -> list[str]:
    lines = textwrap.wrap(text, WIDTH - len(indent) - 6, break_long_words=False, break_on_hyphens=False)
    if len(lines) == 1:
        return [f"{indent}/* {lines[0]} */"]
    return [
        f"{indent}{'/*' if i == 0 else ' *'} {line}{' */' if i == len(lines) - 1 else ''}"
        for i, line in enumerate(lines)
    ]


def _defines(rows: Iterable[tuple[str, str]]) -> str:
    rows = list(rows)
    width = max(len(name) for name, _ in rows)
    return "".join(f"#define {name:{width}} {value}\n" for name, value in rows)


def _constants(schema: Schema) -> str:
    rows = [
        ("WIRE_VERSION", f"{schema.version}"),
        ("WIRE_OLDEST_HOST_VERSION", f"{schema.oldest_host_version}"),
        ("WIRE_SCHEMA_HASH", f"0x{schema.hash:08X}u"),
        ("WIRE_MAX_PACKET_BYTES", f"{schema.max_packet_bytes}u"),
        *((f"WIRE_{name.upper()}", f"{value}u") for name, value in schema.limits.items()),
    ]
    text = _defines(rows)
    for constant in schema.constants:
        number = f"0x{constant.value:X}u" if constant.value > 0xFFFF else f"{constant.value}u"
        lines = ["", *_comment(f"{constant.doc}."), f"#define WIRE_{constant.name.upper()} {number}", ""]
        text += "\n".join(lines)
    return text


def _enum(choice: Choice) -> str:
    lines = [*_comment(choice.doc), f"enum wire_{choice.name} {{"]
    for value in choice.values:
        lines.extend(_comment(value.doc, "    "))
        lines.append(f"    WIRE_{choice.name.upper()}_{value.name.upper()} = {value.value},")
    return "\n".join([*lines, "};"]) + "\n"


def _sizes(schema: Schema) -> str:
    rows = [(f"WIRE_{s.name.upper()}_BYTES", f"{s.fixed_bytes}u") for s in schema.structs]
    text = "/* Bytes on the wire. MIN: with empty arrays. */\n" + _defines(rows) + "\n"
    rows = []
    for group in (*schema.records, *schema.packets):
        prefix = f"WIRE_{group.name.upper()}"
        rows.append((f"{prefix}_MIN_BYTES", f"{group.fixed_bytes}u"))
        rows.append((f"{prefix}_MAX_BYTES", f"{group.max_bytes}u"))
    text += _defines(rows) + "\n/* Ranges of fields. */\n"
    rows = []
    for group in (*schema.records, *schema.packets):
        for field in group.fields:
            if field.range is None:
                continue
            prefix = f"WIRE_{group.name.upper()}_{field.name.upper()}"
            low, high = (_number(field, limit) for limit in field.range)
            if group.counts(field) is None and not field.range_max_name:
                rows.append((f"{prefix}_MIN", low))
            rows.append(
                (f"{prefix}_MAX", f"WIRE_{field.range_max_name.upper()}" if field.range_max_name else high)
            )
    return text + _defines(rows)


def _number(field: Field, value: float) -> str:
    if field.type == "f32" or field.scale is not None:
        text = f"{value:.9g}"
        text = f"{text if '.' in text or 'e' in text else text + '.0'}f"
    else:
        text = f"{int(value)}u" if field.type[0] == "u" else f"{int(value)}"
    return f"({text})" if value < 0 else text


def _c_type(field: Field) -> str:
    if field.is_struct:
        return f"struct wire_{field.type}"
    return "float" if field.is_smallest_three or field.scale is not None else TYPES[field.type]


def _struct(group: Group) -> str:
    lines = [*_comment(group.doc), f"struct wire_{group.name} {{"]
    for field in group.fields:
        lines.extend(_comment(_field_doc(field), "    "))
        if field.is_smallest_three:
            lines.append(f"    float {field.name}[4];")
            lines.append(f"    bool {field.name}_valid;")
            continue
        size = ""
        if isinstance(field.count, str):
            counter = group.counter(field)
            limit = counter.range_max_name or f"{group.name}_{counter.name}_max"
            size = f"[WIRE_{limit.upper()}]"
        elif field.is_array:
            size = f"[{field.count}]"
        lines.append(f"    {_c_type(field)} {field.name}{size};")
    return "\n".join([*lines, "};"]) + "\n"


def _field_doc(field: Field) -> str:
    facts = []
    if field.choice:
        facts.append(f"wire_{field.choice}")
    if field.unit:
        facts.append(field.unit)
    if field.frame:
        facts.append(f"{field.frame} frame" if " " not in field.frame else field.frame)
    if field.invalid is not None:
        facts.append("NaN: invalid" if field.scale is not None else f"{field.invalid}: invalid")
    return field.doc + (f" ({', '.join(facts)})" if facts else "")


def _sigma_code(schema: Schema) -> str:
    rows = [(f"{t:.9g}f,", f"{degrees(t):.3g} deg") for t in schema.sigma.thresholds_rad]
    width = max(len(number) for number, _ in rows)
    last = len(rows) - 1
    return "\n".join(
        [
            *_comment(schema.sigma.doc + " Negative or NaN: unknown."),
            "static inline uint8_t wire_sigma_code(float sigma_rad) {",
            f"    static const float threshold_rad[{last + 1}] = {{",
            *(f"        {number:{width}} /* {text} */" for number, text in rows),
            "    };",
            "    uint8_t code = 0;",
            "    if (!(sigma_rad >= 0.0f))",
            f"        return {schema.sigma.unknown};",
            f"    for (uint8_t step = {1 << (last.bit_length() - 1)}; step > 0; step /= 2)",
            f"        if (code + step <= {last} && sigma_rad > threshold_rad[code + step - 1])",
            "            code = (uint8_t)(code + step);",
            "    return code;",
            "}",
            "",
        ]
    )
