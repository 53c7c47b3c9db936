"""The functions of the C header that turn values into bytes and back."""

from __future__ import annotations

from collections.abc import Iterator

from generator.schema import Field, Group, SmallestThree

WIDTH = 110
TYPES = {
    "u8": "uint8_t",
    "u16": "uint16_t",
    "u32": "uint32_t",
    "u64": "uint64_t",
    "i8": "int8_t",
    "i16": "int16_t",
    "i24": "int32_t",
    "i32": "int32_t",
    "f32": "float",
}


def quaternion(q: SmallestThree) -> str:
    """Functions that put and get a quaternion of this type."""
    word = "uint32_t" if q.word_bits <= 32 else "uint64_t"
    invalid = "0" if q.invalid is None else f"0x{q.invalid:X}u"
    put = [
        f"static inline uint8_t *wire_put_{q.type}(uint8_t *out, const float q[4], bool valid) {{",
        "    uint32_t index, codes[3];",
        f"    {word} word = {invalid};",
        f"    if (valid && wire_smallest_three(q, {q.levels}.0f, &index, codes)) {{",
        f"        word = index{'' if q.valid_bit is None else f' | ({word})1 << {q.valid_bit}'};",
        "        for (unsigned k = 0; k < 3; k++)",
        f"            word |= ({word})codes[k] << (2 + {q.bits} * k);",
        "    }",
    ]
    read = [
        f"static inline bool wire_get_{q.type}(struct wire_reader *reader, float q[4]) {{",
    ]
    if q.word_bits == 32:
        put.append("    return wire_put_u32(out, word);")
        read.append("    const uint32_t word = wire_get(reader, 4);")
    else:
        put.append("    out = wire_put_u32(out, (uint32_t)word);")
        put.append(f"    return wire_put_u{q.word_bits - 32}(out, (uint{q.word_bits - 32}_t)(word >> 32));")
        read.append("    const uint64_t low = wire_get(reader, 4);")
        read.append(f"    const uint64_t word = low | (uint64_t)wire_get(reader, {q.word_bytes - 4}) << 32;")
    mask = f"0x{(1 << q.bits) - 1:X}u"
    ok = f"(word >> {q.valid_bit} & 1) != 0" if q.valid_bit is not None else f"word != {invalid}"
    read += [
        "    uint32_t codes[3];",
        "    for (unsigned k = 0; k < 3; k++)",
        f"        codes[k] = (uint32_t)(word >> (2 + {q.bits} * k)) & {mask};",
        f"    if ({ok})",
        f"        return wire_smallest_three_inverse(word & 3, codes, {q.levels}, q);",
        "    q[0] = q[1] = q[2] = q[3] = NAN;",
        "    return false;",
    ]
    return "\n".join([*put, "}", "", *read, "}", ""])


def _put_scalar(field: Field, value: str) -> str:
    if field.is_smallest_three:
        return f"out = wire_put_{field.type}(out, {value}, {value}_valid);"
    if field.scale is not None:
        low, high = field.scaled_limits
        value = f"wire_scaled({value}, {field.scale:.9g}f, {low}, {high}, {field.invalid})"
    if field.type in ("f32", "i24", "u8", "u16", "u32", "u64") and field.scale is None:
        return f"out = wire_put_{field.type}(out, {value});"
    bits = field.type[1:]
    return f"out = wire_put_u{bits}(out, (uint{bits}_t){value});"


def _get_scalar(field: Field) -> str:
    if field.type == "f32":
        return "wire_get_f32(reader)"
    if field.type == "u64":
        return "wire_get_u64(reader)"
    if field.type[0] == "u":
        cast = "" if field.type == "u32" else f"({TYPES[field.type]})"
        return f"{cast}wire_get(reader, {field.bytes})"
    cast = f"({TYPES[field.type]})" if field.bytes < 3 else ""
    return f"{cast}wire_get_signed(reader, {field.bytes})"


def _put_field(field: Field, owner: str) -> Iterator[str]:
    value = f"{owner}->{field.name}"
    if not field.is_array:
        yield f"    {_put_scalar(field, value)}"
    elif field.type == "u8":
        count = f"{owner}->{field.count}" if field.is_variable else f"{field.count}"
        yield f"    out = wire_put_bytes(out, {value}, {count});"
    else:
        count = f"{owner}->{field.count}" if field.is_variable else f"{field.count}"
        yield f"    for (unsigned i = 0; i < {count}; i++)"
        if field.is_struct:
            yield f"        out = wire_put_{field.type}(out, &{value}[i]);"
        else:
            yield f"        {_put_scalar(field, value + '[i]')}"


def _get_field(field: Field, owner: str) -> Iterator[str]:
    value = f"{owner}->{field.name}"
    count = f"{owner}->{field.count}" if field.is_variable else f"{field.count}"
    if field.is_smallest_three:
        yield f"    {value}_valid = wire_get_{field.type}(reader, {value});"
    elif field.scale is not None:
        yield f"    const int32_t {field.name} = {_get_scalar(field)};"
        number = f"(float){field.name} * {field.scale:.9g}f"
        yield f"    {value} = {field.name} == {field.invalid} ? NAN : {number};"
    elif not field.is_array:
        yield f"    {value} = {_get_scalar(field)};"
    elif field.type == "u8":
        yield f"    wire_get_bytes(reader, {value}, {count});"
    else:
        yield f"    for (unsigned i = 0; i < {count}; i++)"
        if field.is_struct:
            yield f"        wire_get_{field.type}(reader, &{value}[i]);"
        else:
            yield f"        {value}[i] = {_get_scalar(field)};"


def put_struct(group: Group) -> str:
    """The function that writes one item of an array."""
    lines = [
        f"static inline uint8_t *wire_put_{group.name}(uint8_t *out, const struct wire_{group.name} *item) {{"
    ]
    for field in group.fields:
        lines.extend(_put_field(field, "item"))
    return "\n".join([*lines, "    return out;", "}", ""])


def get_struct(group: Group) -> str:
    """The function that reads one item of an array."""
    name = group.name
    lines = [f"static inline void wire_get_{name}(struct wire_reader *reader, struct wire_{name} *item) {{"]
    for field in group.fields:
        lines.extend(_get_field(field, "item"))
    return "\n".join([*lines, "}", ""])


def pack(group: Group) -> str:
    """wire_X_pack of a packet or record."""
    name, upper = group.name, group.name.upper()
    arrays = [f for f in group.fields if f.is_variable]
    lines = _signature(
        f"static inline size_t wire_{name}_pack(",
        f"const struct wire_{name} *{name}",
        "uint8_t *out",
        "size_t capacity",
    )
    for field in arrays:
        counter = group.counter(field)
        lines.append(f"    if ({name}->{counter.name} > WIRE_{upper}_{counter.name.upper()}_MAX)")
        lines.append("        return 0;")
    lines.append(f"    {'' if arrays else 'const '}size_t size = WIRE_{upper}_MIN_BYTES;")
    for field in arrays:
        item = f" * WIRE_{field.type.upper()}_BYTES" if field.is_struct else ""
        lines.append(f"    size += {name}->{field.count}{item};")
    lines += ["    if (size > capacity)", "        return 0;"]
    if group.id is not None:
        lines.append(f"    out = wire_put_u8(out, WIRE_PACKET_{upper});")
    for field in group.fields:
        lines.extend(_put_field(field, name))
    lines[-1] = lines[-1].replace("out = ", "", 1) if not group.fields[-1].is_array else lines[-1]
    return "\n".join([*lines, "    return size;", "}", ""])


def unpack(group: Group) -> str:
    """wire_X_unpack of a packet or record."""
    name, upper = group.name, group.name.upper()
    what = "packet" if group.id is not None else "record"
    lines = _signature(
        f"static inline int wire_{name}_unpack(",
        f"const uint8_t *{what}",
        "size_t n",
        f"struct wire_{name} *{name}",
    )
    lines.append(f"    struct wire_reader whole = {{{what}, n, false}}, *reader = &whole;")
    if group.id is not None:
        lines.append(f"    if (wire_get(reader, 1) != WIRE_PACKET_{upper})")
        lines.append("        return WIRE_ERROR_TYPE;")
    for field in group.fields:
        if field.is_variable:
            counter = group.counter(field)
            lines.append(f"    if ({name}->{counter.name} > WIRE_{upper}_{counter.name.upper()}_MAX)")
            lines.append("        return WIRE_ERROR_COUNT;")
        lines.extend(_get_field(field, name))
    lines.append("    return whole.truncated ? WIRE_ERROR_TRUNCATED : (int)(n - whole.left);")
    return "\n".join([*lines, "}", ""])


def _signature(start: str, *parameters: str) -> list[str]:
    lines = [start]
    for k, parameter in enumerate(parameters):
        piece = parameter + (", " if k < len(parameters) - 1 else ") {")
        if len(lines[-1]) + len(piece.rstrip()) > WIDTH:
            lines.append(" " * len(start))
        lines[-1] += piece
    return [line.rstrip() for line in lines]
