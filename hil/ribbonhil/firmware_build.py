"""Builds ribbonhil._firmware: the firmware's own C as a cffi module, declared by its own headers.

python hil/ribbonhil/firmware_build.py            builds in place, beside this file
python hil/ribbonhil/firmware_build.py --check    only compiles, with the project's warnings as errors

setup.py takes `ffibuilder` from here.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from cffi import FFI

HIL = Path(__file__).resolve().parents[1]
FIRMWARE = HIL.parent / "firmware" / "src"
NATIVE = HIL / "ribbonhil" / "native"

# A header stands after those it includes. All that these declare can be called from Python.
HEADERS = (
    FIRMWARE / "wire.h",
    FIRMWARE / "framing.h",
    FIRMWARE / "ribbon.h",
    FIRMWARE / "sensors" / "part.h",
    FIRMWARE / "bridge_offset.h",
    FIRMWARE / "slot.h",
    FIRMWARE / "plausibility.h",
    FIRMWARE / "drift.h",
    FIRMWARE / "schedule.h",
    FIRMWARE / "outbox.h",
    FIRMWARE / "calibration.h",
    FIRMWARE / "stencil.h",
    FIRMWARE / "rest_filter.h",
    FIRMWARE / "two_axis.h",
    FIRMWARE / "branch.h",
    FIRMWARE / "quaternion.h",
    FIRMWARE / "fusion.h",
    FIRMWARE / "health.h",
    FIRMWARE / "board.h",
    FIRMWARE / "port" / "host" / "host_board.h",
    FIRMWARE / "calibration_store.h",
    NATIVE / "fault.h",
    NATIVE / "truth_table.h",
    NATIVE / "noise.h",
    NATIVE / "flip_flop_chain.h",
    NATIVE / "sample_clock.h",
    NATIVE / "lis2dw12_model.h",
    NATIVE / "mmc5983ma_model.h",
    NATIVE / "hmc5983_model.h",
    NATIVE / "sensor_errors.h",
    NATIVE / "sensor.h",
    NATIVE / "sensor_bus.h",
    NATIVE / "emulated_ribbon.h",
    NATIVE / "event_log.h",
    NATIVE / "replayed_ribbon.h",
)
NATIVE_SOURCES = (
    "fault.c",
    "truth_table.c",
    "noise.c",
    "flip_flop_chain.c",
    "sample_clock.c",
    "lis2dw12_model.c",
    "mmc5983ma_model.c",
    "hmc5983_model.c",
    "sensor_errors.c",
    "sensor.c",
    "sensor_bus.c",
    "emulated_ribbon.c",
    "replayed_ribbon.c",
)


def firmware_sources() -> list[Path]:
    """What firmware/src/sources.mk lists for the board that is made of memory."""
    text = (FIRMWARE / "sources.mk").read_text(encoding="utf-8").replace("\\\n", " ")
    lists = dict(re.findall(r"^(\w+_SOURCES)\s*:=(.*)$", text, re.MULTILINE))
    wanted = ("PURE_SOURCES", "APPLICATION_SOURCES", "HOST_PORT_SOURCES")
    return [FIRMWARE / name for key in wanted for name in lists[key].split()]


SOURCES = (*firmware_sources(), *(NATIVE / name for name in NATIVE_SOURCES))
INCLUDE_DIRS = (FIRMWARE, NATIVE)

# Without contraction of a * b + c every machine gets the same bits, as the Cortex-M4 does with -std=c11.
COMPILE_ARGS = ("-std=c11", "-O2", "-ffp-contract=off", "-fno-math-errno")
WARNINGS = ("-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wvla", "-Wconversion", "-Wdouble-promotion")

_INTEGER = re.compile(r"-?(?:0x[0-9a-fA-F]+|\d+)[uUlL]*")
_INTEGER_EXPRESSION = re.compile(r"(?:[A-Za-z_]\w*|(?:0x[0-9a-fA-F]+|\d+)[uUlL]*\b|[-+*/%<>|&^~(), ])+")
_DEFINE = re.compile(r"#\s*define\s+([A-Za-z_]\w*)[ \t]+(.+)")


def declarations(header_path: Path) -> str:
    """What cffi needs of a C header: integer constants, types, and functions, inline ones included.

    Constants and array lengths that are not plain numbers get their value from the compiler, which cffi does
    only for unions that have a name.
    """
    text = header_path.read_text(encoding="utf-8").replace("\\\n", " ")
    text = re.sub(r"/\*.*?\*/|//[^\n]*", " ", text, flags=re.DOTALL)
    lines = (_constant(line) if line.lstrip().startswith("#") else line for line in text.splitlines())
    text = _without_bodies("\n".join(lines))
    text = re.sub(r"_Static_assert\s*\(.*?\)\s*;|static const [^;]*;", "", text, flags=re.DOTALL)
    return _array_lengths(text)


def _constant(directive: str) -> str:
    define = _DEFINE.match(directive.strip())
    if define is None:
        return ""
    name, value = define[1], define[2].strip()
    if _INTEGER.fullmatch(value):
        return f"#define {name} {value}"
    return f"#define {name} ..." if _INTEGER_EXPRESSION.fullmatch(value) else ""


def _without_bodies(text: str) -> str:
    """Static inline definitions as declarations."""
    pieces, at = [], 0
    for start in re.finditer(r"static inline ([^{;]*)\{", text):
        if start.start() < at:
            continue
        pieces += [text[at : start.start()], start[1].rstrip(), ";"]
        depth, at = 1, start.end()
        while depth:
            depth += {"{": 1, "}": -1}.get(text[at], 0)
            at += 1
    return "".join([*pieces, text[at:]])


def _array_lengths(text: str) -> str:
    """Lengths that are no number: left to the compiler in a structure, and out of a parameter."""

    def length(bracket: re.Match[str]) -> str:
        if _INTEGER.fullmatch(bracket[1].strip()):
            return bracket[0]
        before = text[: bracket.start()]
        return "[]" if before.rfind("(") > before.rfind(";") else "[...]"

    return re.sub(r"\[([^\]]+)\]", length, text)


def _includes() -> str:
    """A C program that includes every header, each as the firmware's own sources do."""
    names = (
        header.relative_to(folder)
        for header in HEADERS
        for folder in INCLUDE_DIRS
        if header.is_relative_to(folder)
    )
    return "".join(f'#include "{name.as_posix()}"\n' for name in names)


def builder() -> FFI:
    """The module's builder, with every header declared."""
    ffi = FFI()
    for header in HEADERS:
        ffi.cdef(declarations(header))
    ffi.set_source(
        "ribbonhil._firmware",
        _includes(),
        sources=[str(source) for source in SOURCES],
        include_dirs=[str(folder) for folder in INCLUDE_DIRS],
        depends=[str(header) for header in HEADERS],
        # Both ways of building must write the same file: two would shadow each other.
        py_limited_api=False,
        extra_compile_args=list(COMPILE_ARGS),
    )
    return ffi


def build_in_place() -> Path:
    """Compiles the module; one that is in use stays whole, its file is replaced."""
    with tempfile.TemporaryDirectory() as folder:
        built = Path(ffibuilder.compile(tmpdir=folder, verbose=False))
        target = HIL / "ribbonhil" / built.name
        partial = target.with_suffix(f".{os.getpid()}")
        partial.write_bytes(built.read_bytes())
        partial.replace(target)
    return target


def check_warnings() -> int:
    """0, or 1 if the compiler warns of a source or of an inline function in a header."""
    headers = _includes()
    compiler = [os.environ.get("CC", "cc"), *COMPILE_ARGS, *WARNINGS, "-c", "-o", os.devnull]
    compiler += [f"-I{folder}" for folder in INCLUDE_DIRS]
    failures = sum(subprocess.run([*compiler, str(source)]).returncode != 0 for source in SOURCES)
    failures += subprocess.run([*compiler, "-xc", "-"], input=headers, text=True).returncode != 0
    return int(failures > 0)


ffibuilder = builder()


def main() -> int:
    """Returns the exit status: that of the compiler."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="build nothing, exit 1 if the compiler warns")
    if parser.parse_args().check:
        return check_warnings()
    build_in_place()
    return 0


if __name__ == "__main__":
    sys.exit(main())
