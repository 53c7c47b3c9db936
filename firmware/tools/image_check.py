"""Fails the build of an image that is too large, may run out of stack, or contains what it must not."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

import stack_usage

FLASH_BYTES_MAX = 64 * 1024
RAM_BYTES_MAX = 32 * 1024
STACK_BYTES_MAX = 4 * 1024

FLASH_SECTIONS = (".vectors", ".text", ".data")
RAM_SECTIONS = (".stack", ".data", ".bss", ".noinit")

BANNED = {
    "memory allocation": r"_?(malloc|calloc|realloc|free|sbrk)(_r)?",
    "formatted output": r"_?(v?(s|sn|f|i|si|sni|fi)?printf|puts|putchar|fwrite)(_r)?",
    "double precision in software": r"__(aeabi_(d|cd|f2d|i2d|ui2d|l2d|ul2d)\w*|\w+df\d?)",
    "trigonometry": r"(__\w+_)?a?(sin|cos|tan)h?f?|(__\w+_)?atan2f?|sincosf?",
}


class ImageError(Exception):
    """The image breaks a rule; the message says which."""


def section_bytes(size_output: str) -> dict[str, int]:
    """Bytes of each section, out of `size -A`."""
    return {
        name: int(size) for name, size in re.findall(r"^(\.\S+)\s+(\d+)\s+\d+$", size_output, re.MULTILINE)
    }


def check_sizes(sections: dict[str, int]) -> str:
    """One line that tells the sizes; raises ImageError if one is beyond its budget."""
    flash = sum(sections.get(name, 0) for name in FLASH_SECTIONS)
    ram = sum(sections.get(name, 0) for name in RAM_SECTIONS)
    if flash > FLASH_BYTES_MAX:
        raise ImageError(f"the image takes {flash} bytes of flash, the budget is {FLASH_BYTES_MAX}")
    if ram > RAM_BYTES_MAX:
        raise ImageError(f"the image takes {ram} bytes of static RAM, the budget is {RAM_BYTES_MAX}")
    return f"flash {flash} of {FLASH_BYTES_MAX} bytes, static RAM {ram} of {RAM_BYTES_MAX}"


def check_symbols(symbols: list[str]) -> None:
    """Raises ImageError for a function that has no place in the image."""
    for what, pattern in BANNED.items():
        found = [symbol for symbol in symbols if re.fullmatch(pattern, symbol)]
        if found:
            raise ImageError(f"{what} is in the image: {', '.join(found)}")


INTERRUPTS = (
    "systick_handler",
    "usart2_handler",
    "usart3_handler",
    "dma1_stream3_handler",
    "dma1_stream6_handler",
)


def check_stack(call_graphs: list[Path], indirect_calls: Path) -> str:
    """One line that tells the worst case; raises ImageError if it is beyond the budget or not known."""
    try:
        graph = stack_usage.read_call_graph(call_graphs)
        stack_usage.add_indirect_calls(graph, stack_usage.read_indirect_calls(indirect_calls))
        interrupts = [name for name in INTERRUPTS if name in graph.frame_bytes]
        worst, calls = stack_usage.worst_case(
            graph, "main", interrupts, "nmi_handler", "fault_record_and_restart"
        )
    except stack_usage.StackError as error:
        raise ImageError(f"worst-case stack: {error}") from error
    chain = " > ".join(name.rpartition(":")[2] for name in calls)
    if worst > STACK_BYTES_MAX:
        raise ImageError(f"the stack can take {worst} bytes, the budget is {STACK_BYTES_MAX}: {chain}")
    return f"stack {worst} of {STACK_BYTES_MAX} at worst ({chain}; and an interrupt)"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tools", default="arm-none-eabi-", help="prefix of size and nm")
    parser.add_argument("--indirect-calls", type=Path, required=True)
    parser.add_argument("elf", type=Path)
    parser.add_argument("call_graphs", type=Path, nargs="+")
    arguments = parser.parse_args()

    def run(*command: str) -> str:
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    symbols = [line.split()[-1] for line in run(f"{arguments.tools}nm", str(arguments.elf)).splitlines()]
    try:
        check_symbols(symbols)
        sizes = check_sizes(section_bytes(run(f"{arguments.tools}size", "-A", str(arguments.elf))))
        stack = check_stack(arguments.call_graphs, arguments.indirect_calls)
    except ImageError as error:
        print(f"{arguments.elf}: {error}", file=sys.stderr)
        return 1
    print(f"{sizes}, {stack}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
