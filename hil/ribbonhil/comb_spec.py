"""The parameters of an emulated comb, and the emulated:// URLs that carry them."""

import math
from dataclasses import dataclass, fields, replace
from urllib.parse import parse_qsl, quote, unquote, urlencode, urlsplit

from ribbonhost.errors import UsageError

from ribbonhil.disturbances import Disturbance, parse_disturbance
from ribbonhil.faults import NO_FAULTS, LinkFaults

SCHEME = "emulated"
FORM = "emulated://SCENE/INDEX?ribbons=5&seed=0&period_s=20&noise=1"


@dataclass(frozen=True)
class CombSpec:
    """What an emulated comb is; two of the same parameters in one process are the same comb.

    scene: name of a built-in scene, or path of a Python file.
    ribbons: on the reference, which comes on top.
    period_s: of the motion; None: the scene's own.
    noise: times the noise of the parts' data sheets.
    clock_ppm: each device's clock is wrong by at most that; drawn by the seed.
    baud: of each device's link, bits a second.
    image: path of an STM32F405 image that runs in place of the firmware as a module; its clock is exact.
    board: that the image was built for.
    part_errors: seed of what is wrong with the parts; None: they are ideal, noise aside.
    warming_c: by how much the ribbons warm up after they are powered up.
    disturb: what disturbs the earth's field, see disturbances.FORM; several with semicolons between.
    """

    scene: str = "wing"
    ribbons: int = 5
    seed: int = 0
    period_s: float | None = None
    noise: float = 1.0
    dip_deg: float = 62.0
    field_ut: float = 48.0
    clock_ppm: float = 20.0
    baud: int = 921_600
    image: str = ""
    board: str = "pyboard_v11"
    part_errors: int | None = None
    warming_c: float = 0.0
    disturb: str = ""

    def __post_init__(self) -> None:
        """Raises UsageError for values that make no comb."""
        limits = {
            "seed": (0, 2**31 - 1),
            "noise": (0.0, 1000.0),
            "dip_deg": (-90.0, 90.0),
            "field_ut": (0.0, 1000.0),
            "clock_ppm": (0.0, 10_000.0),
            "baud": (1200, 12_000_000),
            "warming_c": (-100.0, 100.0),
            "part_errors": (0, 2**31 - 1),
        }
        for name, (lowest, highest) in limits.items():
            value = getattr(self, name)
            if value is not None and not lowest <= value <= highest:
                raise UsageError(f"{name} = {value:g} is not between {lowest:g} and {highest:g}")

    def disturbances(self) -> tuple[Disturbance, ...]:
        """What disturbs the field. Raises UsageError for a text that says nothing."""
        return tuple(parse_disturbance(text) for text in self.disturb.split(";") if text)

    def url(self, index: int, faults: LinkFaults = NO_FAULTS) -> str:
        """Where ribbon `index` can be opened; 0 is the reference."""
        query = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "scene"}
        given = {"ribbons": self.ribbons, "seed": self.seed}
        given |= {name: value for name, value in query.items() if value != getattr(_DEFAULT, name)}
        return f"{SCHEME}://{quote(self.scene, safe='')}/{index}?{urlencode(given | faults.changed())}"


_DEFAULT = CombSpec()


@dataclass(frozen=True)
class Address:
    """One ribbon of an emulated comb, and the faults of the link to it."""

    comb: CombSpec
    index: int
    faults: LinkFaults = NO_FAULTS


def parse_url(url: str) -> Address:
    """What an emulated:// URL means. Raises UsageError if it means nothing."""
    parts = urlsplit(url)
    scene, place = unquote(parts.netloc), parts.path.removeprefix("/")
    if parts.scheme != SCHEME or not scene:
        raise UsageError(f"{url} is not of the form {FORM}")
    comb: dict[str, float | str] = {}
    faults: dict[str, float] = {}
    for name, text in parse_qsl(parts.query, keep_blank_values=True):
        if name in _TEXTS:
            comb[name] = text
        elif name in _COMB_NUMBERS:
            comb[name] = _number(name, text)
        elif name in _FAULT_NUMBERS:
            faults[name] = _number(name, text)
        else:
            known = sorted(_TEXTS | _COMB_NUMBERS | _FAULT_NUMBERS)
            raise UsageError(f"{url}: there is no option {name}; there are {', '.join(known)}")
    spec = replace(CombSpec(scene=scene), **comb)  # type: ignore[arg-type]
    if not place.isdecimal() or int(place) > spec.ribbons:
        raise UsageError(
            f"{url}: after the scene comes a ribbon, 0 (reference) to {spec.ribbons}, not {place!r}"
        )
    return Address(spec, int(place), LinkFaults(**faults))


_TEXTS = {"image", "board", "disturb"}
_COMB_NUMBERS = {f.name for f in fields(CombSpec)} - _TEXTS - {"scene"}
_FAULT_NUMBERS = {f.name for f in fields(LinkFaults)}
_WHOLE = {"ribbons", "seed", "baud", "part_errors"}


def _number(name: str, text: str) -> float:
    try:
        value = int(text) if name in _WHOLE else float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        kind = "whole number" if name in _WHOLE else "number"
        raise UsageError(f"{name} must be a {kind}, not {text!r}")
    return value
