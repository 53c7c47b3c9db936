"""Random values of packets and records, as hypothesis strategies built from the schema."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import both_codecs as both
import slow_packer as slow
from hypothesis import strategies as st

SINGLE = st.one_of(st.just(math.nan), st.floats(width=32, allow_nan=False), st.floats(-2, 2, width=32))
COMPONENT = st.one_of(st.floats(-1, 1), st.sampled_from([0.0, 1.0, -1.0, 0.5, -0.5, 0.5**0.5]))
STRANGE = st.one_of(COMPONENT, st.floats(allow_nan=True, allow_infinity=True))
QUATERNION = st.one_of(
    st.none(),
    st.lists(COMPONENT, min_size=4, max_size=4),
    st.lists(STRANGE, min_size=4, max_size=4),
)
NAMES = (*slow.PACKETS, *slow.RECORDS)


def integers(kind: str) -> st.SearchStrategy[int]:
    """Any number that this type holds."""
    bits = int(kind[1:])
    low = 0 if kind[0] == "u" else -(1 << bits - 1)
    return st.integers(low, low + (1 << bits) - 1)


def member(row: Mapping[str, Any]) -> st.SearchStrategy[Any]:
    """One number, or one quaternion."""
    if row["type"] in slow.QUATERNIONS:
        return QUATERNION
    if row["type"] == "f32":
        return SINGLE
    if "scale" in row:
        return st.one_of(st.none(), st.floats(-400, 400), st.sampled_from([math.inf, -math.inf, 1e39]))
    return integers(row["type"])


def structure(name: str) -> st.SearchStrategy[dict[str, Any]]:
    """One item of an array."""
    columns = {}
    for row in both.rows_of(name):
        several = st.lists(member(row), min_size=row.get("count", 1), max_size=row.get("count", 1))
        columns[row["name"]] = several if "count" in row else member(row)
    return st.fixed_dictionaries(columns)


@st.composite
def fields(draw: st.DrawFn, name: str) -> dict[str, Any]:
    """Values of all fields; arrays of any length they may have, but mostly short ones."""
    values: dict[str, Any] = {}
    rows = both.rows_of(name)
    for row in rows:
        if both.is_counter(name, row):
            most = row["range"][1]
            most = slow.SCHEMA["wire"].get(most, most)
            values[row["name"]] = draw(st.one_of(st.integers(0, 3), st.just(16), st.just(most)))
        elif "struct" in row:
            count = values[row["count"]]
            some = draw(st.lists(structure(row["struct"]), min_size=min(count, 3), max_size=min(count, 3)))
            values[row["name"]] = [some[i % len(some)] for i in range(count)]
        elif "count" in row:
            count = values.get(row["count"], row["count"])
            values[row["name"]] = draw(st.binary(min_size=count, max_size=count)).hex()
        else:
            values[row["name"]] = draw(member(row))
    return values
