"""What generate.py makes of a schema: rules it enforces, the hash, and the form of its code."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import generate
import pytest
import slow_packer as slow
from generator import c, python
from generator.errors import SchemaError
from generator.read import load
from ribbonhost import wire
from schemas import LATER, TEXT, changed

ROOT = slow.PROTOCOL.parent
GENERATED = ("firmware/src/wire.h", "host/ribbonhost/wire.py", "protocol/PROTOCOL.md")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(slow.PROTOCOL / "generate.py"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A copy of what generate.py reads and writes."""
    for name in (*GENERATED, "protocol/schema.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def test_generated_files_are_what_the_schema_says() -> None:
    result = run("--check")
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (GENERATED[0], "uint16_t", "int16_t"),
        (GENERATED[1], "t_us: int", "t_us: str"),
        (GENERATED[2], "| `u16` |", "| `i16` |"),
    ],
)
def test_check_names_a_file_that_differs_and_leaves_it(tree: Path, name: str, old: str, new: str) -> None:
    path = tree / name
    text = changed(old, new, path.read_text())
    path.write_text(text)
    result = run("--check", "--root", str(tree))
    assert result.returncode == 1
    assert (
        result.stderr == f"{name} is not what protocol/schema.toml says: run python protocol/generate.py.\n"
    )
    assert path.read_text() == text
    assert run("--root", str(tree)).stdout == f"wrote {name}\n"
    assert path.read_text() == (ROOT / name).read_text()


def test_check_tells_of_a_missing_file_and_a_wrong_schema(tree: Path) -> None:
    (tree / GENERATED[0]).unlink()
    assert run("--check", "--root", str(tree)).returncode == 1
    schema = tree / "protocol/schema.toml"
    schema.write_text(changed("id = 0x13", "id = 0x12"))
    result = run("--root", str(tree))
    assert result.returncode == 1
    assert result.stderr == "generate.py: Two have the same packet id, 18: change one of them.\n"
    schema.unlink()
    assert run("--root", str(tree)).stderr.count("\n") == 1


def test_generated_files_name_their_source_in_the_first_line() -> None:
    for name in GENERATED[:2]:
        first = (ROOT / name).read_text().splitlines()[0]
        assert "protocol/schema.toml" in first
        assert "protocol/generate.py" in first


BROKEN = {
    "unknown type": (('type = "i24"', 'type = "i23"'), "unknown type i23"),
    "duplicate id": (("id = 0x03", "id = 0x02"), "same packet id, 2"),
    "reserved id": (("id = 0x01", "id = 0"), "0 is reserved"),
    "id beyond a byte": (("id = 0x01", "id = 256"), "use 1 to 255"),
    "duplicate packet": (('[[packet]]\nname = "raw"', '[[packet]]\nname = "orient"'), "same name in C"),
    "duplicate field": (('name = "scans"', 'name = "overruns"'), "same field in status, overruns"),
    "duplicate enum value": (
        ('name = "pin", value = 2', 'name = "pin", value = 1'),
        "same value in reset_cause, 1",
    ),
    "duplicate flag": (('name = "raw", bit = 2', 'name = "raw", bit = 1'), "same bit in mode"),
    "enum value beyond a byte": (
        ('name = "pin", value = 2', 'name = "pin", value = 256'),
        "does not fit in a byte",
    ),
    "count field after its array": (
        ('count = "node_count", doc = "from', 'count = "later", doc = "from'),
        "counted by later, which is not a field before it",
    ),
    "count without range": (
        ('{ name = "data_count", type = "u8", range = [0, 192]', '{ name = "data_count", type = "u8"'),
        "must be one u8 with a range from 0",
    ),
    "count field used twice": (
        ('count = "mag_count"', 'count = "accel_count"'),
        "counts another array already",
    ),
    "structure of another size": (("bytes = 7\n", "bytes = 8\n"), "has bytes = 8, but its fields take 7"),
    "unknown structure": (('struct = "mag_raw"', 'struct = "compass_raw"'), "which is not defined before it"),
    "unknown enumeration": (('enum = "board"', 'enum = "bored"'), "enum bored must be defined"),
    "enum on a wide field": (
        ('{ name = "board", type = "u8"', '{ name = "board", type = "u16"'),
        "the field one u8",
    ),
    "unknown key": (
        ('unit = "us", doc = "as in ORIENT"', 'units = "us", doc = "as in ORIENT"'),
        "has units, which means nothing",
    ),
    "missing prose": ((', doc = "comes back" }', " }"), "lacks 'doc'"),
    "scale without invalid": ((', invalid = -32768, doc = "of the MCU', ', doc = "of the MCU'), "as invalid"),
    "packet beyond its limit": (
        ("max_packet_bytes = 576", "max_packet_bytes = 564"),
        "can be 565 bytes long",
    ),
    "array of numbers in a packet": (
        ('{ name = "scan_us", type = "u16",', '{ name = "scan_us", type = "u16", count = 2,'),
        "only u8 may be an array",
    ),
    "C keyword": (('name = "tag", type', 'name = "switch", type'), "no keyword"),
    "Python keyword": (('name = "tag", type', 'name = "lambda", type'), "no keyword"),
    "capital letter": (('name = "tag", type', 'name = "Tag", type'), "lower case"),
    "field of the generated code": (
        ('name = "tag", type', 'name = "octets", type'),
        "taken by the generated code",
    ),
    "class taken by another": (
        ('[[packet]]\nname = "raw"', '[[packet]]\nname = "node_array"'),
        "same name in Python, NodeArray",
    ),
    "function taken by the prelude": (
        (
            "[[record]]",
            '[[struct]]\nname = "u32"\nbytes = 1\ndoc = "x"\n'
            'fields = [{ name = "a", type = "u8", doc = "x" }]\n[[record]]',
        ),
        "same name in C, wire_put_u32",
    ),
    "constant taken": (('name = "identify_max_ms"', 'name = "node_max"'), "same name in C, WIRE_NODE_MAX"),
    "quaternion beyond its word": (
        ("bits = 15\nword_bits = 48", "bits = 16\nword_bits = 48"),
        "does not fit",
    ),
    "wrong kind of value": (("id = 0x01", 'id = "one"'), "of the wrong kind"),
    "no TOML": (("[wire]", "[wire"), "is not TOML"),
}


@pytest.mark.parametrize(("change", "sentence"), BROKEN.values(), ids=BROKEN.keys())
def test_broken_rule_is_told_in_one_sentence(change: tuple[str, str], sentence: str) -> None:
    with pytest.raises(SchemaError) as caught:
        load(changed(*change))
    message = str(caught.value)
    assert sentence in message
    assert "\n" not in message
    assert message.endswith(".")


PROSE = {
    "comment": ("# What goes over the wire", "# What travels"),
    "doc of a field": ('doc = "comes back" }', 'doc = "returns" }'),
    "doc of a packet": ('doc = "ORIENT for slow links."', 'doc = "For slow links."'),
    "doc of a value": ('doc = "power applied"', 'doc = "power came"'),
    "unit": ('unit = "us", doc = "as in ORIENT"', 'unit = "microseconds", doc = "as in ORIENT"'),
    "version": ("\nversion = 2", "\nversion = 3"),
    "range": ("range = [1, 200]", "range = [1, 250]"),
}
LAYOUT = {
    "name of a field": ('name = "scan_us"', 'name = "scan_time_us"'),
    "type": ('name = "calibration_crc32", type = "u32"', 'name = "calibration_crc32", type = "i32"'),
    "packet id": ("id = 0x05", "id = 0x06"),
    "order": (
        '{ name = "wire_version", type = "u8", doc = "version of this schema the device speaks" },\n'
        '  { name = "oldest_host_version", type = "u8",',
        '{ name = "oldest_host_version", type = "u8", doc = "version of this schema the device speaks" },\n'
        '  { name = "wire_version", type = "u8",',
    ),
    "count": ('name = "unique_id", type = "u8", count = 12', 'name = "unique_id", type = "u8", count = 16'),
    "enum value": ('name = "brown_out", value = 5', 'name = "brown_out", value = 7'),
    "new enum value": (
        '{ name = "ok", value = 0, doc = "done" }',
        '{ name = "ok", value = 0, doc = "done" }, { name = "later", value = 99, doc = "x" }',
    ),
    "flag": ('name = "raw", bit = 2', 'name = "raw", bit = 3'),
    "scale": ("scale = 0.01", "scale = 0.02"),
    "invalid value": (
        'scale = 0.01, unit = "degC", invalid = -32768',
        'scale = 0.01, unit = "degC", invalid = 32767',
    ),
    "sigma": ("ratio = 1.5848931925", "ratio = 1.6"),
    "quaternion": (
        "valid_bit = 47",
        "valid_bit = 47 # x\n[[smallest_three]]\nbits = 12\nword_bits = 40\nvalid_bit = 39",
    ),
}


@pytest.mark.parametrize("change", PROSE.values(), ids=PROSE.keys())
def test_hash_stays_when_only_prose_changes(change: tuple[str, str]) -> None:
    assert load(changed(*change)).hash == load(TEXT).hash == wire.SCHEMA_HASH


@pytest.mark.parametrize("change", LAYOUT.values(), ids=LAYOUT.keys())
def test_hash_changes_with_the_layout(change: tuple[str, str]) -> None:
    assert load(changed(*change)).hash != load(TEXT).hash


@pytest.mark.parametrize("text", [TEXT, LATER], ids=["schema", "later"])
@pytest.mark.parametrize(
    ("emit", "suffix", "command"),
    [
        (c.emit, ".h", ["clang-format", "--dry-run", "-Werror", f"--style=file:{ROOT / '.clang-format'}"]),
        (python.emit, ".py", ["ruff", "format", "--check", "--config", str(ROOT / "host/pyproject.toml")]),
        (python.emit, ".py", ["ruff", "check", "--config", str(ROOT / "host/pyproject.toml")]),
    ],
    ids=["clang-format", "ruff format", "ruff check"],
)
def test_generated_code_is_in_the_format_of_the_project(
    text: str, emit: Callable[..., str], suffix: str, command: list[str], tmp_path: Path
) -> None:
    path = tmp_path / f"wire{suffix}"
    path.write_text(emit(load(text)))
    command = [str(Path(sys.executable).with_name(command[0])), *command[1:], str(path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_generator_needs_only_the_standard_library() -> None:
    sources = [slow.PROTOCOL / "generate.py", *(slow.PROTOCOL / "generator").glob("*.py")]
    imported = set()
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if path.name == "prelude.py":
                continue
            if isinstance(node, ast.Import):
                imported.update(alias.name.split(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                imported.add(str(node.module).split(".")[0])
    assert imported - set(sys.stdlib_module_names) == {"generator"}


def test_main_returns_its_exit_status(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert generate.main(["--check", "--root", str(tree)]) == 0
    (tree / "protocol/PROTOCOL.md").write_text("# Protocol\n")
    assert generate.main(["--check", "--root", str(tree)]) == 1
    assert capsys.readouterr().err.count("\n") == 1
