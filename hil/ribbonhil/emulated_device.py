"""What makes one emulated device differ from another: serial number, clock, parts, and their seed."""

from dataclasses import dataclass

import numpy as np

from ribbonhil._firmware import lib
from ribbonhil.part_errors import PartErrors, drawn_errors
from ribbonhil.truth import SLOT_COUNT

BAUD = 921_600
WARMING_S = 120.0
UNIQUE_ID_MARK = b"EMUL"
"""How the unique id of every emulated device ends, so that none is taken for hardware."""
PARTS = (lib.WIRE_PART_LIS2DW12, lib.WIRE_PART_MMC5983MA) * (SLOT_COUNT // 2)


@dataclass(frozen=True)
class Device:
    """What makes a device itself.

    seed: of the sensors' noise, offsets and oscillators, and of the select chain's first state.
    noise: times the noise of the data sheets.
    clock_ppm: by which its clock is fast.
    clock_offset_us: what its clock shows at power-up.
    temperature_c: when it is powered up; it rises by warming_c with a time constant of warming_s.
    parts: of each slot, a wire.Part each.
    errors: of those parts; None: they are ideal, noise aside.
    """

    seed: int = 0
    unique_id: bytes = bytes(12)
    noise: float = 1.0
    clock_ppm: float = 0.0
    clock_offset_us: int = 0
    baud: int = BAUD
    temperature_c: float = 25.0
    warming_c: float = 0.0
    warming_s: float = WARMING_S
    parts: tuple[int, ...] = PARTS
    errors: PartErrors | None = None

    @property
    def serial(self) -> str:
        """The serial number: the unique id in hexadecimal."""
        return self.unique_id.hex()


def drawn_device(
    seed: int,
    index: int,
    *,
    noise: float = 1.0,
    clock_ppm_max: float = 20.0,
    baud: int = BAUD,
    part_errors: int | None = None,
    warming_c: float = 0.0,
) -> Device:
    """The device at a place of a comb: unique id, clock and sensors drawn from the comb's seed.

    part_errors: the seed of what is wrong with its parts; None: nothing is.
    """
    random = np.random.default_rng([seed, index])
    return Device(
        seed=int(random.integers(2**63)),
        unique_id=random.bytes(12)[: -len(UNIQUE_ID_MARK)] + UNIQUE_ID_MARK,
        noise=noise,
        clock_ppm=float(random.uniform(-clock_ppm_max, clock_ppm_max)),
        clock_offset_us=int(random.integers(2**32)),
        baud=baud,
        warming_c=warming_c,
        errors=None if part_errors is None else drawn_errors(part_errors, index, PARTS),
    )
