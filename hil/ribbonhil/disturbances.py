"""Things that disturb the earth's field around emulated ribbons: magnets, steel, what a ribbon carries.

All of them are sums of dipoles: what a magnet of any shape is from further away than its size.
"""

from dataclasses import dataclass, fields
from math import isfinite, pi

import numpy as np
from ribbonhost.errors import UsageError

from ribbonhil.rotations import Array

MU_0_UT_M_PER_A = 0.4 * pi  # magnetic constant, with the field in microtesla
NEAREST_M = 5e-3  # closer than this a dipole has no meaning: it reads as from there
BEAM_PIECES = 48

Vector = tuple[float, float, float]


def dipole_ut(at_m: Array, dipole_m: Array, moment_am2: Array) -> Array:
    """Field (..., 3) in microtesla at points (..., 3) of a dipole with a moment (..., 3) in A m^2.

    B = mu_0 / 4 pi * (3 (m . u) u - m) / r^3.
    """
    away_m = at_m - dipole_m
    r_m = np.linalg.norm(away_m, axis=-1, keepdims=True)
    u = away_m / np.maximum(r_m, 1e-12)
    along = np.sum(moment_am2 * u, axis=-1, keepdims=True)
    moment = 3 * along * u - moment_am2
    return np.asarray(MU_0_UT_M_PER_A / (4 * pi) * moment / np.maximum(r_m, NEAREST_M) ** 3)


@dataclass(frozen=True)
class Magnet:
    """A magnet that stays at a place of the world; moment_am2: its dipole moment, A m^2."""

    position_m: Vector
    moment_am2: Vector = (0.0, 0.0, 1.0)

    def field_ut(self, position_m: Array, r_world_node: Array, earth_ut: Array) -> Array:
        """What it adds at sensors (K, R + 1, S, 3), in the world."""
        return dipole_ut(position_m, np.array(self.position_m), np.array(self.moment_am2))


@dataclass(frozen=True)
class SteelBeam:
    """A beam of soft steel from start_m to end_m, magnetised by the earth's field.

    area_m2: of its steel. Along the beam it is magnetised to H / N, N = (ln 2p - 1) / p^2 the demagnetising
    factor of a rod of length-to-diameter ratio p (Osborn 1945), across to 2 H: both for a permeability far
    above 1 / N.
    """

    start_m: Vector
    end_m: Vector
    area_m2: float = 2e-3

    def __post_init__(self) -> None:
        """Raises UsageError for a beam without length or thickness."""
        if self.start_m == self.end_m:
            raise UsageError("a beam goes from a point to another, not to the same point")
        if not self.area_m2 > 0:
            raise UsageError(f"the area of a beam is more than 0 m^2, not {self.area_m2:g}")

    def field_ut(self, position_m: Array, r_world_node: Array, earth_ut: Array) -> Array:
        """What it adds at sensors (K, R + 1, S, 3), in the world."""
        start_m, end_m = np.array(self.start_m), np.array(self.end_m)
        length_m = float(np.linalg.norm(end_m - start_m))
        axis = (end_m - start_m) / length_m
        slenderness = max(length_m / (2 * np.sqrt(self.area_m2 / pi)), 2.0)
        factor = (np.log(2 * slenderness) - 1) / slenderness**2
        h_a_per_m = earth_ut / MU_0_UT_M_PER_A
        h_along = np.dot(h_a_per_m, axis)
        magnetisation = axis * h_along / factor + 2 * (h_a_per_m - axis * h_along)
        moment_am2 = magnetisation * self.area_m2 * length_m / BEAM_PIECES
        total = np.zeros(position_m.shape)
        for piece in range(BEAM_PIECES):
            centre_m = start_m + (end_m - start_m) * (piece + 0.5) / BEAM_PIECES
            total += dipole_ut(position_m, centre_m, moment_am2)
        return total


@dataclass(frozen=True)
class CarriedMagnet:
    """A magnetised object on a ribbon, fixed to the frame of a slot; its offset and moment are in that."""

    ribbon: int
    slot: int
    offset_m: Vector = (0.0, 0.0, 0.02)
    moment_am2: Vector = (0.0, 0.0, 1e-3)

    def field_ut(self, position_m: Array, r_world_node: Array, earth_ut: Array) -> Array:
        """What it adds at sensors (K, R + 1, S, 3), in the world."""
        r = r_world_node[:, self.ribbon, self.slot]
        place_m = position_m[:, self.ribbon, self.slot] + r @ np.array(self.offset_m)
        moment_am2 = r @ np.array(self.moment_am2)
        return dipole_ut(position_m, place_m[:, None, None], moment_am2[:, None, None])


Disturbance = Magnet | SteelBeam | CarriedMagnet
_KINDS: dict[str, type[Magnet] | type[SteelBeam] | type[CarriedMagnet]] = {
    "magnet": Magnet,
    "beam": SteelBeam,
    "carried": CarriedMagnet,
}
_SHORT = {
    "position_m": "at",
    "moment_am2": "moment",
    "start_m": "from",
    "end_m": "to",
    "area_m2": "area",
    "ribbon": "ribbon",
    "slot": "slot",
    "offset_m": "offset",
}
FORM = (
    "magnet:at=0.3,0.3,-0.1:moment=0,0,1, beam:from=0,0.4,-0.2:to=2,0.4,-0.2:area=0.002, "
    "or carried:ribbon=1:slot=9:offset=0,0,0.02:moment=0,0,0.001"
)


def parse_disturbance(text: str) -> Disturbance:
    """A disturbance from its text, see FORM: metres, A m^2, m^2. Raises UsageError if it is none."""
    kind, *parts = text.split(":")
    if kind not in _KINDS:
        raise UsageError(f"{text!r} is no disturbance: give {FORM}")
    values: dict[str, float | int | Vector] = {}
    wanted = {_SHORT[f.name]: f for f in fields(_KINDS[kind])}
    for part in parts:
        name, _, value = part.partition("=")
        if name not in wanted:
            raise UsageError(f"{text!r}: a {kind} has {', '.join(wanted)}, not {name!r}")
        count = 3 if wanted[name].type is Vector else 1
        values[wanted[name].name] = _numbers(text, name, value, count, whole=wanted[name].type is int)
    try:
        return _KINDS[kind](**values)  # type: ignore[arg-type]
    except TypeError:
        missing = [
            short for short, f in wanted.items() if f.name not in values and f.default is f.default_factory
        ]
        raise UsageError(f"{text!r} lacks {', '.join(missing)}: give {FORM}") from None


def _numbers(text: str, name: str, value: str, count: int, *, whole: bool) -> float | int | Vector:
    try:
        numbers = [int(item) if whole else float(item) for item in value.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(isfinite(number) for number in numbers):
        what = (
            "a whole number" if whole else "a number" if count == 1 else "three numbers with commas between"
        )
        raise UsageError(f"{text!r}: {name} must be {what}")
    return numbers[0] if count == 1 else (numbers[0], numbers[1], numbers[2])
