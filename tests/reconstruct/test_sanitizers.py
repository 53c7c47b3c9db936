"""The C solver under the address and undefined-behaviour sanitizers."""

import os
import subprocess
from pathlib import Path

import pytest
from ribbonhost.native.build import HERE, SOURCES

DRIVER = Path(__file__).with_name("drive_solver.c")
FLAGS = (
    "-std=c11",
    "-g",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
)


def compile_with(*arguments: object, cwd: Path) -> None:
    command = [os.environ.get("CC", "cc"), *FLAGS, f"-I{HERE}", *map(str, arguments)]
    subprocess.run(command, check=True, cwd=cwd)


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the solver's object files."""
    folder = tmp_path_factory.mktemp("sanitized")
    compile_with("-c", *(HERE / name for name in SOURCES if not name.startswith("motion_")), cwd=folder)
    return folder


def run(driver: Path, objects: Path) -> subprocess.CompletedProcess[str]:
    program = objects / driver.stem
    compile_with(driver, *sorted(objects.glob("*.o")), "-lm", "-o", program, cwd=objects)
    return subprocess.run([program], capture_output=True, text=True, timeout=100, check=False)


def test_solver_is_clean_under_sanitizers(objects: Path) -> None:
    done = run(DRIVER, objects)
    assert (done.returncode, done.stderr) == (0, "")


def test_sanitizers_would_find_a_fault(objects: Path) -> None:
    """A workspace one number too short ends the program."""
    source = DRIVER.read_text()
    short = source.replace("numbers(4 * nodes)", "numbers(4 * nodes - 1)")
    assert short != source
    changed = objects / "too_short.c"
    changed.write_text(short)
    done = run(changed, objects)
    assert done.returncode != 0
    assert "heap-buffer-overflow" in done.stderr
