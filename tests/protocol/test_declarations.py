"""What firmware_build takes out of C headers for cffi."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest
import slow_packer as slow
from cffi import FFI
from ribbonhil._firmware import ffi, lib

BUILD = slow.PROTOCOL.parent / "hil/ribbonhil/firmware_build.py"
HEADER = """\
/* A comment; with static inline int no(void) { } in it. */
#ifndef SHAPE_H
#define SHAPE_H

#include <stdint.h>

#define SHAPE_SIDES    3u // of each
#define SHAPE_MASK     0xF0u
#define SHAPE_ERROR    (-2)
#define SHAPE_BYTES    (SHAPE_SIDES * 2u + \\
                        1u)
#define SHAPE_WIDTH_M  1e-3f
#define SHAPE_LENGTH_M 2.5f
#define SHAPE_NAME     "shape"
#define SHAPE_AREA(a)  ((a) * (a))
_Static_assert(sizeof(int) >= 2, "a comma, and a ; in a string");

struct shape {
    uint8_t bytes[SHAPE_BYTES];
    int16_t grid[2][SHAPE_SIDES];
};

static inline int shape_sum(const struct shape *shape, int weight[SHAPE_SIDES]) {
    int sum = 0;
    for (unsigned i = 0; i < SHAPE_SIDES; i++) {
        sum += shape->bytes[i] * weight[i];
    }
    return sum;
}

static inline void shape_nothing(void) {}
int shape_outside(float q[4]);

#endif
"""


@pytest.fixture(scope="module")
def declarations_of_header(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("header") / "shape.h"
    path.write_text(HEADER)
    spec = importlib.util.spec_from_file_location("firmware_build", BUILD)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["firmware_build"] = module
    spec.loader.exec_module(module)
    text = module.declarations(Path(path))
    assert isinstance(text, str)
    return text


def test_inline_functions_become_declarations(declarations_of_header: str) -> None:
    for declaration in (
        "int shape_sum(const struct shape *shape, int weight[]);",
        "void shape_nothing(void);",
        "int shape_outside(float q[4]);",
    ):
        assert declaration in declarations_of_header
    assert "{ }" not in declarations_of_header
    assert "return" not in declarations_of_header


def test_only_integer_constants_are_taken(declarations_of_header: str) -> None:
    lines = [line for line in declarations_of_header.splitlines() if line.startswith("#")]
    assert lines == [
        "#define SHAPE_SIDES 3u",
        "#define SHAPE_MASK 0xF0u",
        "#define SHAPE_ERROR ...",
        "#define SHAPE_BYTES ...",
    ]


def test_cffi_accepts_them(declarations_of_header: str) -> None:
    other = FFI()
    other.cdef(declarations_of_header)
    assert "uint8_t bytes[...];" in declarations_of_header
    assert "int16_t grid[2][...];" in declarations_of_header


def test_values_of_the_built_module_are_those_of_the_schema() -> None:
    wire = slow.SCHEMA["wire"]
    assert wire["max_packet_bytes"] == lib.WIRE_MAX_PACKET_BYTES
    assert lib.WIRE_ERROR_TYPE == -3
    assert ffi.sizeof(ffi.new("struct wire_orient *").nodes) == wire["node_max"] * ffi.sizeof(
        "struct wire_node"
    )
    for enum in slow.SCHEMA["enum"]:
        for value in slow.SCHEMA["enum"][enum]["values"]:
            assert getattr(lib, f"WIRE_{enum}_{value['name']}".upper()) == value["value"]
