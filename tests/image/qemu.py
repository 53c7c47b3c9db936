"""QEMU's netduinoplus2, an STM32F405 written by others: an independent reference for the core."""

import os
import select
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

USART2 = 1  # index of -serial


class Qemu:
    """Runs an ELF file, with this process at the other end of its USART2."""

    def __init__(self, elf: Path) -> None:
        # Time goes by instructions, 8 ns each, and never waits for the clock on the wall.
        clock = ["-icount", "shift=3,sleep=off"]
        serial = ["-serial", "null"] * USART2 + ["-serial", "stdio"]
        machine = ["-M", "netduinoplus2", "-kernel", str(elf), "-display", "none", "-monitor", "none"]
        self._process = subprocess.Popen(
            ["qemu-system-arm", *machine, *clock, *serial],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self.received = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()

    def run_until(self, satisfied: Callable[[bytes], bool], seconds: float = 20.0) -> bytes:
        """All that came, as soon as it satisfies; after `seconds` of real time whatever came by then."""
        assert self._process.stdout is not None
        end = time.monotonic() + seconds
        while not satisfied(self.received) and (left := end - time.monotonic()) > 0:
            ready, _, _ = select.select([self._process.stdout], [], [], left)
            if ready:
                self.received += os.read(self._process.stdout.fileno(), 65536)
        return self.received

    def write(self, data: bytes) -> None:
        """Bytes toward the program."""
        assert self._process.stdin is not None
        self._process.stdin.write(data)
        self._process.stdin.flush()
