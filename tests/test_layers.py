"""The rooms of the project look only into the rooms they may (docs/architecture.md)."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)

# Module of ribbonhost: what it may import of the project when it is loaded. A package stands for all in it.
HOST_MAY_IMPORT = {
    "ribbonhost": set(),
    "ribbonhost.errors": set(),
    "ribbonhost.wire": set(),
    "ribbonhost.framing": {"wire"},
    "ribbonhost.clock": {"errors"},
    "ribbonhost.link": {"errors", "wire", "framing"},
    "ribbonhost.device": {"errors", "wire", "framing", "link", "clock"},
    "ribbonhost.comb": {"errors"},
    "ribbonhost.origins": set(),
    "ribbonhost.native": {"errors"},
    "ribbonhost.reconstruct": {"errors", "native"},
    "ribbonhost.motion": {"errors", "wire", "native", "reconstruct"},
    "ribbonhost.pipeline": {
        "errors",
        "wire",
        "framing",
        "link",
        "clock",
        "device",
        "comb",
        "record",
        "reconstruct",
        "motion",
    },
    "ribbonhost.cli": {
        "errors",
        "wire",
        "framing",
        "link",
        "clock",
        "device",
        "comb",
        "reconstruct",
        "pipeline",
        "bench",
        "record",
        "export",
        "validate",
        "calibrate",
        "motion",
        "out",
    },
    "ribbonhost.out": {"errors", "origins", "pipeline"},
    "ribbonhost.view": {"errors", "origins", "wire", "device", "reconstruct", "pipeline", "export"},
    "ribbonhost.calibrate": {"errors", "wire"},
    "ribbonhost.validate": {"errors", "reconstruct"},
    "ribbonhost.export": {"errors"},
    "ribbonhost.record": {"errors", "wire", "framing"},
    "ribbonhost.bench": {"errors", "wire", "framing", "native", "reconstruct", "motion", "calibrate"},
}
HIL_MAY_IMPORT = {"errors", "wire", "framing", "link", "clock", "device", "comb"}
SLOW_TO_IMPORT = {"numpy", "scipy"}


def python_files(folder: str) -> Iterator[tuple[str, Path]]:
    """(module name, path) of all Python files of a package."""
    base = ROOT / folder
    for path in sorted(base.rglob("*.py")):
        parts = path.relative_to(base.parent).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


def imports_when_loaded(source: str) -> set[str]:
    """Names that a module imports when it is loaded: all but those inside functions and for type checkers."""
    found: set[str] = set()
    todo: list[ast.AST] = [ast.parse(source)]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            module = node.module or ""
            found.update(f"{module}.{alias.name}" for alias in node.names)
        for_types = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not for_types:
            todo.extend(ast.iter_child_nodes(node))
    return found


def forbidden_imports(module: str, source: str) -> list[str]:
    """Imports of `module` that its room does not allow."""
    if module.split(".")[0] in ("ribbonhil", "checks"):
        return [
            name
            for name in sorted(imports_when_loaded(source))
            if name.startswith("ribbonhost.") and name.split(".")[1] not in HIL_MAY_IMPORT
        ]
    room = max((r for r in HOST_MAY_IMPORT if module == r or module.startswith(r + ".")), key=len)
    own = room.partition(".")[2]
    forbidden = []
    for name in sorted(imports_when_loaded(source)):
        top, *rest = name.split(".")
        wrong_room = (
            top == "ribbonhost" and bool(rest) and rest[0] not in HOST_MAY_IMPORT[room] | {own, "__version__"}
        )
        slow_cli = own in ("cli", "bench") and module.endswith("cli") and top in SLOW_TO_IMPORT
        # The bench measures against emulated truth; its cli must load without the emulator.
        emulator = top == "ribbonhil" and (own != "bench" or module.endswith("cli"))
        if wrong_room or slow_cli or emulator:
            forbidden.append(name)
    return forbidden


def forbidden_includes(path: str, source: str) -> list[str]:
    """Quoted includes of a C file that its room does not allow; `path` is relative to the project."""
    includes = INCLUDE.findall(source)
    name = Path(path).name
    forbidden = []
    for include in includes:
        target = Path(include).name
        if path.startswith("host/"):
            bad = not target.startswith("ribbon_native") and not (Path(ROOT / path).parent / include).exists()
            bad = bad or "firmware" in include
        elif path.startswith("firmware/"):
            in_port = "/port/" in path
            # A port includes its own files by their bare names; nobody else may name one.
            ports = {p.name for p in (ROOT / "firmware/src/port").rglob("*.h")}
            bad = not in_port and (target in ports or "port/" in include)
            bad = bad or (is_pure(path) and target in {"board.h", "app.h", "app_state.h"})
        elif name.endswith(("_model.c", "_model.h")):
            parts = {p.name for p in (ROOT / "firmware/src/sensors").glob("*.h")}
            bad = target in parts and not target.endswith("_regs.h")
        else:
            bad = False
        if bad:
            forbidden.append(include)
    return forbidden


def pure_sources() -> set[str]:
    """Names of the files that firmware/src/sources.mk lists as pure, and of their headers."""
    text = (ROOT / "firmware/src/sources.mk").read_text().replace("\\\n", " ")
    line = re.search(r"^\s*PURE\w*\s*:?=\s*(.+)$", text, re.MULTILINE)
    assert line, "firmware/src/sources.mk must list the pure files"
    files = {Path(word).name for word in line[1].split()}
    return files | {Path(word).with_suffix(".h").name for word in files}


def is_pure(path: str) -> bool:
    return Path(path).name in pure_sources()


@pytest.mark.parametrize("folder", ["host/ribbonhost", "hil/ribbonhil", "hil/checks"])
def test_python_modules_import_only_what_their_room_allows(folder: str) -> None:
    wrong = {m: bad for m, p in python_files(folder) if (bad := forbidden_imports(m, p.read_text()))}
    assert wrong == {}


def test_c_files_include_only_what_their_room_allows() -> None:
    wrong = {}
    for folder in ("firmware/src", "host/ribbonhost/native", "hil/ribbonhil"):
        for path in sorted((ROOT / folder).rglob("*.[ch]")):
            relative = path.relative_to(ROOT).as_posix()
            if path.name.startswith("_"):
                continue  # written by cffi
            if bad := forbidden_includes(relative, path.read_text()):
                wrong[relative] = bad
    assert wrong == {}


def test_pure_firmware_files_are_named_and_exist() -> None:
    existing = {p.name for p in (ROOT / "firmware/src").rglob("*.c")}
    listed = {name for name in pure_sources() if name.endswith(".c")}
    assert listed
    assert listed <= existing


def test_generated_files_name_their_source() -> None:
    for path in ("firmware/src/wire.h", "host/ribbonhost/wire.py"):
        assert "protocol/schema.toml" in (ROOT / path).read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("ribbonhost.reconstruct.comb", "from ribbonhost.device import Device"),
        ("ribbonhost.device", "import ribbonhost.reconstruct"),
        ("ribbonhost.wire", "from ribbonhost.framing import crc16"),
        ("ribbonhost.framing", "from ribbonhost.link import open_link"),
        ("ribbonhost.record.recorder", "from ribbonhost.cli import options"),
        ("ribbonhost.record.reader", "from ribbonhost.device import Device"),
        ("ribbonhost.pipeline", "import ribbonhil.emulator"),
        ("ribbonhost.cli.stream_cli", "import numpy as np"),
        ("ribbonhost.cli.viewing", "from ribbonhost.view import View"),
        ("ribbonhost.pipeline.stream", "from ribbonhost.view import View"),
        ("ribbonhil.emulator", "from ribbonhost.pipeline import Pipeline"),
    ],
)
def test_a_forbidden_python_import_is_found(module: str, source: str) -> None:
    assert forbidden_imports(module, source)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("host/ribbonhost/native/curve.c", '#include "../../../firmware/src/wire.h"'),
        ("firmware/src/fusion.c", '#include "board.h"'),
        ("firmware/src/app.c", '#include "port/host/host_board.h"'),
        ("firmware/src/app.c", '#include "host_board.h"'),
        ("hil/ribbonhil/native/lis2dw12_model.c", '#include "sensors/lis2dw12.h"'),
    ],
)
def test_a_forbidden_include_is_found(path: str, source: str) -> None:
    assert forbidden_includes(path, source)
