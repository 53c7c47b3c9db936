"""The emulated comb of `ribbonhost stream --emulate`."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.errors import LinkError
from ribbonhost.link import register_emulator


@dataclass(frozen=True)
class Emulation:
    """Emulated ribbons and what is true of them.

    Attributes:
        urls: their ports, the reference first.
        comb: the comb they make.
        truth_m: positions (R + 1, n, 3) of the nodes at a host time, metres, from the reference's anchor.
    """

    urls: tuple[str, ...]
    comb: Comb
    truth_m: Callable[[float], NDArray[np.float64]]


@contextmanager
def emulate(
    scene: str,
    *,
    ribbons: int,
    seed: int,
    part_errors: int | None = None,
    disturb: Sequence[str] = (),
) -> Iterator[Emulation]:
    """Runs an emulated comb in this process.

    part_errors: seed of what is wrong with the parts; None: nothing is. disturb: what disturbs the field.

    Raises UsageError for a scene that cannot be, LinkError where ribbonhil is not installed or built.
    """
    register_emulator()
    try:
        from ribbonhil.emulator import EmulatedComb
    except ImportError as error:
        raise LinkError(f"the emulator cannot be loaded ({error}): run `make setup`") from error
    with EmulatedComb(
        scene=scene, ribbons=ribbons, seed=seed, part_errors=part_errors, disturb=";".join(disturb)
    ) as emulated:
        reference, *others = emulated.serials
        comb = Comb(
            reference,
            emulated.pitch_m,
            tuple(
                CombRibbon(serial, start_m)
                for serial, start_m in zip(others, emulated.layout_start_m, strict=True)
            ),
        )
        yield Emulation(tuple(emulated.urls), comb, emulated.truth_node_m)
