"""Where the instructions of a frame go, function by function."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from ribbonhil.stm32f405.elf import FLASH_START, Program


def by_function(program: Program, counts: NDArray[np.uint64]) -> dict[str, int]:
    """Instructions by the function that they are in, most first; what was inlined is with its caller.

    counts: as Mcu.end_profile() returns them."""
    starts = [address for address, _ in program.functions]
    total: dict[str, int] = {}
    for halfword in np.flatnonzero(counts):
        i = bisect_right(starts, FLASH_START + 2 * int(halfword)) - 1
        name = program.functions[i][1] if i >= 0 else "?"
        total[name] = total.get(name, 0) + int(counts[halfword])
    return dict(sorted(total.items(), key=lambda item: -item[1]))
