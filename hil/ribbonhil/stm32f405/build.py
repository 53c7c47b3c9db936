"""Builds ribbonhil.stm32f405._mcu: the STM32F405 around the CPU of `unicorn`, as a cffi module.

python -m ribbonhil.stm32f405.build            builds in place, beside this file
python -m ribbonhil.stm32f405.build --check    only compiles, with the project's warnings as errors
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from cffi import FFI

from ribbonhil.firmware_build import COMPILE_ARGS, WARNINGS, declarations

HERE = Path(__file__).resolve().parent
NATIVE = HERE / "native"
SHARED = HERE.parent / "native"
HEADERS = (SHARED / "event_log.h", NATIVE / "mcu.h")
SOURCES = tuple(
    NATIVE / f"{name}.c"
    for name in (
        "adc",
        "cpu",
        "dma",
        "exceptions",
        "flash",
        "gpio",
        "iwdg",
        "mcu",
        "nvic",
        "peripherals",
        "rcc",
        "spi",
        "string",
        "systick",
        "time",
        "timers",
        "usart",
    )
)


def unicorn_folder() -> Path:
    """Where unicorn's wheel keeps its headers and its library. Raises ModuleNotFoundError without it."""
    spec = find_spec("unicorn")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("unicorn is not installed. Type: pip install unicorn==2.1.4")
    return Path(spec.origin).parent


def builder() -> FFI:
    """The module's builder, with the model's header declared."""
    unicorn = unicorn_folder()
    ffi = FFI()
    for header in HEADERS:
        ffi.cdef(declarations(header))
    ffi.set_source(
        "ribbonhil.stm32f405._mcu",
        '#include "mcu.h"\n',
        sources=[str(source) for source in SOURCES],
        include_dirs=[str(NATIVE), str(SHARED), str(unicorn / "include")],
        depends=[str(header) for header in (*HEADERS, NATIVE / "machine.h")],
        py_limited_api=False,
        # Unicorn exports functions of qemu by names like ours; neither may take the other's.
        extra_compile_args=[*COMPILE_ARGS, "-fvisibility=hidden"],
        extra_link_args=[
            f"-L{unicorn / 'lib'}",
            "-l:libunicorn.so.2",
            f"-Wl,-rpath,{unicorn / 'lib'}",
        ],
    )
    return ffi


def build_in_place() -> Path:
    """Compiles the module and puts it beside this file; one that is in use stays whole."""
    with tempfile.TemporaryDirectory() as folder:
        built = Path(builder().compile(tmpdir=folder, verbose=False))
        target = HERE / built.name
        partial = target.with_suffix(f".{os.getpid()}")
        partial.write_bytes(built.read_bytes())
        partial.replace(target)
    return target


def check_warnings() -> int:
    """0, or 1 if the compiler warns of a source."""
    compiler = [os.environ.get("CC", "cc"), *COMPILE_ARGS, *WARNINGS, "-c", "-o", os.devnull]
    compiler += [f"-isystem{unicorn_folder() / 'include'}", f"-I{NATIVE}", f"-I{SHARED}"]
    return int(any(subprocess.run([*compiler, str(source)]).returncode != 0 for source in SOURCES))


def main() -> int:
    """Returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="build nothing, exit 1 if the compiler warns")
    try:
        if parser.parse_args().check:
            return check_warnings()
        build_in_place()
    except ModuleNotFoundError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
