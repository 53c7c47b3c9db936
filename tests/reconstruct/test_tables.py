"""The constants of the C solver are what their definitions give."""

from pathlib import Path

import pytest
from ribbonhost.native import generate_tables


def test_tables_are_what_their_definitions_give() -> None:
    assert generate_tables.main(["--check"]) == 0


def test_a_changed_constant_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = generate_tables.TABLES.read_text()
    number = next(line.strip(" ,") for line in text.splitlines() if line.startswith("    "))
    changed = tmp_path / "tables.h"
    changed.write_text(text.replace(number, repr(float(number) + 1e-12)))
    monkeypatch.setattr(generate_tables, "TABLES", changed)
    assert generate_tables.main(["--check"]) == 1
