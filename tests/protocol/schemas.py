"""The schema, and one with all that a later version may add to it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import slow_packer as slow
from generator import python
from generator.read import load

TEXT = (slow.PROTOCOL / "schema.toml").read_text(encoding="utf-8")


def changed(old: str, new: str, text: str = TEXT) -> str:
    """The schema with one place changed."""
    assert text.count(old) >= 1, old
    return text.replace(old, new, 1)


def module_of(text: str, folder: Path) -> ModuleType:
    """The Python codec of another schema."""
    path = folder / "other_wire.py"
    path.write_text(python.emit(load(text)))
    spec = importlib.util.spec_from_file_location("other_wire", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["other_wire"] = module
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules["other_wire"]
    return module


ORIENT_NODES = (
    '{ name = "nodes", struct = "node", count = "node_count", doc = "from the connector outward" },\n'
)
APPENDED = """
{ name = "tension_n", type = "i8", scale = 0.5, unit = "N", invalid = -128, doc = "x" },
{ name = "turns", type = "i32", doc = "x" },
{ name = "extra_count", type = "u8", range = [0, 4], doc = "x" },
{ name = "extras", struct = "extra", count = "extra_count", doc = "x" },
"""
EXTRA = """
[[struct]]
name = "extra"
bytes = 24
doc = "New."
fields = [
  { name = "a", type = "i24", doc = "x" },
  { name = "b", type = "i8", count = 2, doc = "x" },
  { name = "c", type = "u32", doc = "x" },
  { name = "d", type = "u64", doc = "x" },
  { name = "e", type = "i32", doc = "x" },
  { name = "f", type = "i8", count = 3, doc = "x" },
]

[[record]]"""
TOUCH = """
[[packet]]
name = "touch"
id = 0x20
from = "device"
doc = "New."
fields = [{ name = "force", type = "i16", doc = "x" }]
"""
# Appended fields after an array, types that the schema does not use yet, and a new packet.
LATER = changed(ORIENT_NODES, ORIENT_NODES + APPENDED, changed("[[record]]", EXTRA)) + TOUCH
