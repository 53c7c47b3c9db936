"""What goes wrong in an emulated ribbon: faults of its sensors and their bus, and of the link to the host."""

import math
from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from ribbonhost.errors import UsageError

from ribbonhil._firmware import lib

BUS = lib.FAULT_BUS
"""The slot of faults that the whole bus has."""


class FaultKind(IntEnum):
    """Faults of native/fault.h, where each is explained with its parameter."""

    ABSENT = lib.FAULT_ABSENT
    WRONG_ID = lib.FAULT_WRONG_ID
    STUCK = lib.FAULT_STUCK
    GARBAGE = lib.FAULT_GARBAGE
    STALE = lib.FAULT_STALE
    INTERMITTENT = lib.FAULT_INTERMITTENT
    DRIFT = lib.FAULT_DRIFT
    BIT_FLIPS = lib.FAULT_BIT_FLIPS
    BROWN_OUT = lib.FAULT_BROWN_OUT
    SELECTED = lib.FAULT_SELECTED
    CROSSED = lib.FAULT_CROSSED
    SHORTED = lib.FAULT_SHORTED
    MISO_LOW = lib.FAULT_MISO_LOW
    MISO_HIGH = lib.FAULT_MISO_HIGH


@dataclass(frozen=True)
class Fault:
    """A fault of one slot (or of the whole BUS) from start_s until end_s, true time."""

    kind: FaultKind
    slot: int
    start_s: float = 0.0
    end_s: float = math.inf
    parameter: float = 0.0


@dataclass(frozen=True)
class LinkFaults:
    """What a link does to the bytes of both directions; the first five are probabilities a byte.

    loss: the byte is lost.
    flip: one of its bits is wrong.
    duplicate: it comes twice.
    insert: a random byte comes before it.
    truncate: it and all that follow up to the next frame delimiter (0x00) are lost.
    disconnect_s, reconnect_s: true times between which the port is gone; infinite: never, for good.
    """

    loss: float = 0.0
    flip: float = 0.0
    duplicate: float = 0.0
    insert: float = 0.0
    truncate: float = 0.0
    disconnect_s: float = math.inf
    reconnect_s: float = math.inf

    def __post_init__(self) -> None:
        """Raises UsageError for what is no probability or no time."""
        for name in ("loss", "flip", "duplicate", "insert", "truncate"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise UsageError(f"{name} = {getattr(self, name):g} is no probability between 0 and 1")
        if not (self.disconnect_s >= 0.0 and self.reconnect_s >= 0.0):
            raise UsageError("disconnect_s and reconnect_s are times in seconds, 0 or more")

    @property
    def corrupts(self) -> bool:
        """Whether bytes are changed at all."""
        return any((self.loss, self.flip, self.duplicate, self.insert, self.truncate))

    def is_connected(self, opened_s: float, now_s: float) -> bool:
        """Whether a port that was opened at a true time is still there at a later one."""
        gone_while_open = opened_s < self.disconnect_s <= now_s
        gone_before = self.disconnect_s <= opened_s < self.reconnect_s
        return not gone_while_open and not gone_before

    def changed(self) -> dict[str, float]:
        """The fields that differ from a link without faults."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}


NO_FAULTS = LinkFaults()


class FaultyLine:
    """One direction of a link with faults: the same bytes come out for a seed, however they are divided."""

    def __init__(self, faults: LinkFaults, seed: int, direction: int) -> None:
        self._faults = faults
        self._random = [np.random.default_rng([seed, direction, use]) for use in range(7)]
        self._cutting = False

    def pass_on(self, data: bytes) -> bytes:
        """What arrives of these bytes."""
        if not self._faults.corrupts or not data:
            return data
        faults, random = self._faults, self._random
        content = np.frombuffer(data, np.uint8).copy()
        happens = [
            random[use].random(len(content)) < probability
            for use, probability in enumerate((faults.loss, faults.flip, faults.duplicate, faults.insert))
        ]
        lost, flipped, twice, preceded = happens
        bit = (8 * random[4].random(len(content))).astype(np.uint8)
        noise = (256 * random[5].random(len(content))).astype(np.uint8)
        lost = lost | self._cut(content, random[6].random(len(content)) < faults.truncate)
        content[flipped] ^= np.uint8(1) << bit[flipped]
        copies = np.where(lost, 0, 1 + twice) + preceded
        out = np.repeat(content, copies)
        first = np.cumsum(copies) - copies
        out[first[preceded]] = noise[preceded]
        return out.tobytes()

    def _cut(self, content: NDArray[np.uint8], starts: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Bytes from a start, or from the beginning if a cut lasts, up to the next delimiter."""
        lost = np.zeros(len(content), bool)
        place = 0
        while place < len(content):
            if not self._cutting:
                rest = np.flatnonzero(starts[place:])
                if not len(rest):
                    break
                place += int(rest[0])
                self._cutting = True
            delimiters = np.flatnonzero(content[place:] == 0)
            end = place + int(delimiters[0]) if len(delimiters) else len(content)
            lost[place:end] = True
            self._cutting = not len(delimiters)
            place = end + 1
        return lost
