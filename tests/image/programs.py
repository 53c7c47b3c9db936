"""Builds the programs that the tests of the image run, once for all test processes."""

import fcntl
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
OUT = FIRMWARE / "build/stm32f405"


def make(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs `make -C firmware`, one at a time, whoever else does the same."""
    OUT.mkdir(parents=True, exist_ok=True)
    with (OUT / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return subprocess.run(
            ["make", "--no-print-directory", "-C", str(FIRMWARE), *arguments],
            capture_output=True,
            text=True,
            check=False,
        )


def built(name: str = "ribbon", board: str = "pyboard_v11", core: bool = True) -> Path:
    """The ELF file of a program: the firmware, or the same with NAME.c of this folder as its main.

    core=False: the port only, without the application."""
    arguments = [f"BOARD={board}", f"NAME={name}"]
    if name != "ribbon":
        arguments.append(f"MAIN={Path(__file__).with_name(f'{name}.c')}")
    if not core:
        arguments.append("CORE=")
    elf = OUT / f"{board}-921600" / f"{name}.elf"
    result = make(*arguments, str(elf.relative_to(FIRMWARE)))
    assert result.returncode == 0, result.stdout + result.stderr
    return elf
