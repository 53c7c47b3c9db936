"""The functions of the Python codec that turn values into bytes and back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from generator.schema import Field, Group, Schema, SmallestThree, class_name

STRUCT_CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i8": "b", "i16": "h", "i32": "i", "f32": "f"}
# Signed and wide enough that differences of values do not wrap.
ARRAYS = {"u8": "uint8", "u32": "int64", "u64": "uint64", "f32": "float64"}


def item_codec(schema: Schema, group: Group) -> str:
    """The layout of a structure, and the functions that write and read arrays of it."""
    cls, name = f"{class_name(group.name)}Array", group.name
    quaternions = {q.type: q for q in schema.smallest_three}
    rows: list[str] = []
    write: list[str] = []
    read: list[str] = []
    for field in group.fields:
        q = quaternions.get(field.type)
        octets = q.word_bytes if q else 3 if field.type == "i24" else 0
        shape = [n for n in (field.count if field.is_array else 0, octets) if n]
        kind = "u1" if octets else f"<{field.type[0]}{field.bytes}"
        rows.append(f'("{field.name}", "{kind}"' + (f", {tuple(shape)})" if shape else ")"))
        write += _items_to_bytes(field, q)
        read += _items_from_bytes(field, q)
    names = [n for f in group.fields for n in ((f.name, "valid") if f.is_smallest_three else (f.name,))]
    return "\n".join(
        [
            f"_{name.upper()} = np.dtype(",
            *exploded("    [", rows, "]"),
            ")",
            "",
            "",
            f"def _write_{name}(items: {cls}, count: int, name: str) -> bytes:",
            f"    rows = np.empty(count, _{name.upper()})",
            *write,
            "    return rows.tobytes()",
            "",
            "",
            f"def _read_{name}(octets: bytes, at: int, count: int) -> {cls}:",
            f"    rows = np.frombuffer(octets, _{name.upper()}, count, at)",
            *read,
            *exploded(f"    return {cls}(", [f"{n}={n}" for n in names], ")"),
        ]
    )


def exploded(start: str, items: Iterable[str], end: str) -> list[str]:
    """One item a line, as the formatter leaves it whatever the lengths are."""
    indent = " " * (len(start) - len(start.lstrip()))
    return [start, *(f"{indent}    {item}," for item in items), indent + end]


def _items_to_bytes(field: Field, q: SmallestThree | None) -> Iterator[str]:
    value, where = f"items.{field.name}", f'f"{{name}}.{field.name}"'
    shape = f"(count, {field.count})" if field.is_array else "(count,)"
    if q is not None:
        flag = _hex(1 << q.valid_bit if q.valid_bit else 0)
        options = [f"bits={q.bits}", f"flag={flag}", f"invalid={_hex(q.invalid or 0)}"]
        yield from exploded(
            "    words = _smallest_three(", [value, "items.valid", "count", where, *options], ")"
        )
        yield f'    rows["{field.name}"] = _words_to_octets(words, {q.word_bytes})'
        return
    if field.type == "f32":
        yield f'    rows["{field.name}"] = _checked_floats({value}, {shape}, {where})'
        return
    low, high = field.limits
    yield f"    {field.name} = _checked_ints({value}, {shape}, {low}, {high}, {where})"
    yield f'    rows["{field.name}"] = ' + (
        f"_i24_to_octets({field.name})" if field.type == "i24" else field.name
    )


def _hex(number: int) -> str:
    return f"0x{number:X}" if number else "0"


def _items_from_bytes(field: Field, q: SmallestThree | None) -> Iterator[str]:
    value = f'rows["{field.name}"]'
    if q is not None:
        mark = f"& {_hex(1 << q.valid_bit)} != 0" if q.valid_bit else f"!= {_hex(q.invalid or 0)}"
        yield f"    words = _words_from_octets({value})"
        yield f"    {field.name}, valid = _smallest_three_inverse(words, words {mark}, {q.bits})"
    elif field.type == "i24":
        yield f"    {field.name} = _i24_from_octets({value})"
    elif field.type == "f32":
        yield f"    {field.name} = _doubles({value})"
    else:
        yield f"    {field.name} = {value}.astype(np.{ARRAYS.get(field.type, 'int32')})"


def _runs(group: Group) -> Iterator[tuple[list[Field], Field | None]]:
    """Fixed fields, each run with the variable array that ends it (None after the last)."""
    run: list[Field] = []
    for field in group.fields:
        if field.is_variable:
            yield run, field
            run = []
        else:
            run.append(field)
    if run:
        yield run, None


def codec(group: Group, enums: set[str]) -> str:
    """The layouts of a packet or record, and the functions that encode and decode it."""
    name, cls, upper = group.name, class_name(group.name), group.name.upper()
    layouts: list[str] = []
    encode = [f"def _encode_{name}({name}: {cls}) -> bytes:"]
    decode = [f"def _decode_{name}(octets: bytes) -> tuple[{cls}, int]:", "    at = 0"]
    for field in group.fields:
        if field.is_variable:
            counted = f'len({name}.{field.name}), {_limit(group, field)}, "{cls}.{field.name}"'
            encode.append(f"    {field.count} = _checked_count({counted})")
    encode.append("    pieces = [")
    for k, (run, array) in enumerate(_runs(group)):
        first = k == 0 and group.id is not None
        if run or first:
            layout = f"_{upper}_FIXED" + (f"_{k + 1}" if k else "")
            codes = "B" * first + "".join(_struct_code(f) for f in run)
            layouts.append(f'{layout} = struct.Struct("<{codes}")')
            values = [f"PacketId.{upper}"] * first + [_to_struct(group, f) for f in run]
            encode += exploded(f"        {layout}.pack(", values, "),")
            names = ["_"] * first + [f.name for f in run]
            taken = f') = _take_fixed({layout}, octets, at, "{cls}")'
            # The formatter keeps a name that is alone on the line.
            decode += exploded("    (", names, taken) if len(names) > 1 else [f"    ({names[0]},{taken}"]
            decode.append(f"    at += {layout}.size")
        if array is not None:
            where = f'{array.count}, "{cls}.{array.name}"'
            size = f"_{array.type.upper()}.itemsize" if array.is_struct else "1"
            decode.append(
                f'    end = _end_of_items(octets, at, {array.count}, {_limit(group, array)}, {size}, "{cls}")'
            )
            if array.is_struct:
                encode.append(f"        _write_{array.type}({name}.{array.name}, {where}),")
                decode.append(f"    {array.name} = _read_{array.type}(octets, at, {array.count})")
            else:
                encode.append(f"        _checked_bytes({name}.{array.name}, 0, {where}),")
                decode.append(f"    {array.name} = bytes(octets[at:end])")
            decode.append("    at = end")
    arguments = [f"{f.name}={_from_struct(f, enums)}" for f in group.fields if group.counts(f) is None]
    encode += ["    ]", '    return b"".join(pieces)']
    decode += exploded(f"    {name} = {cls}(", arguments, ")")
    decode.append(f"    return {name}, len(octets) - at")
    return "\n".join([*layouts, "", "", *encode, "", "", *decode])


def _limit(group: Group, field: Field) -> str:
    counter = group.counter(field)
    return counter.range_max_name.upper() or str(group.capacity(field))


def _struct_code(field: Field) -> str:
    return f"{field.count}s" if field.is_array else STRUCT_CODES[field.type]


def _to_struct(group: Group, field: Field) -> str:
    if group.counts(field) is not None:
        return field.name
    value, where = f"{group.name}.{field.name}", f'"{class_name(group.name)}.{field.name}"'
    if field.is_array:
        return f"_checked_bytes({value}, {field.count}, {field.count}, {where})"
    if field.type == "f32":
        return f"_checked_float({value}, {where})"
    if field.scale is not None:
        low, high = field.scaled_limits
        return f"_scaled({value}, {field.scale:.9g}, {low}, {high}, {field.invalid})"
    low, high = field.limits
    return f"_checked_int({value}, {low}, {high}, {where})"


def _from_struct(field: Field, enums: set[str]) -> str:
    if field.scale is not None:
        return f"math.nan if {field.name} == {field.invalid} else {field.name} * {field.scale:.9g}"
    if field.choice in enums:
        return f"_member({class_name(field.choice)}, {field.name})"
    return f"{class_name(field.choice)}({field.name})" if field.choice else field.name
