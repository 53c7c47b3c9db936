"""Whether each sensor of a ribbon at rest is as noisy as its part must be: no more, and no less."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from ribbonhil._firmware import ffi, lib
from ribbonhil.check.bench import Bench
from ribbonhil.check.check import Measurement, Topic, none_of
from ribbonhil.check.readings import SCANS_MIN, Readings

TOPIC = Topic("noise")

NOISY = 2.0
"""Times the data sheet's noise: more is a bad supply, a long ground, or a table that shakes."""
QUIET = 0.4
"""Times the same: less is no measurement of anything."""
REPEATED = 0.1
"""Share of scans with the counts of the scan before that is left to chance at least."""

Array = NDArray[np.float64]


def data_sheet_noise(part: int, rate_hz: int, lsb: float) -> float:
    """Standard deviation of one axis of a part as the firmware sets it for a rate, m/s^2 or uT; or NaN.

    Rounding to counts adds a twelfth of a count squared.
    """
    config = ffi.new("struct part_config *")
    for known in lib.PARTS:
        if known.id == part:
            lib.part_configure(known, rate_hz, config)
            return float(np.hypot(config.noise, lsb / np.sqrt(12)))
    return float("nan")


def without_drift(counts: Array) -> Array:
    """(T, 3) readings without their mean and without what changes steadily, as by warming up."""
    t = np.arange(len(counts)) - (len(counts) - 1) / 2
    slope = t @ counts / (t @ t)
    return np.asarray(counts - counts.mean(axis=0) - t[:, None] * slope)


@TOPIC.check
def noise_of_each_axis(bench: Bench) -> Iterator[Measurement]:
    """Readings at rest scatter as the data sheets say for the rate, on each axis that is used: a noisy one
    has a bad supply or contact, one that is too quiet is stuck, or filled in from somewhere else."""
    readings = bench.at_rest()
    slots = bench.info.slots
    for kind, first in (("accelerometers", 0), ("magnetometers", 1)):
        ratio = noise_ratio(readings, slots.part, slots.axes, first)
        yield none_of(f"{kind} without readings", no_readings(readings, first))
        if not np.isfinite(ratio).any():
            yield Measurement(f"{kind}: noise by the data sheet", "not known", expected="known")
            continue
        loudest = np.unravel_index(np.nanargmax(ratio), ratio.shape)
        quietest = np.unravel_index(np.nanargmin(ratio), ratio.shape)
        middle = float(np.nanmedian(ratio))
        yield Measurement(f"{kind}: times the data sheet, median", middle)
        yield Measurement(
            f"{kind}: times the data sheet, most",
            float(ratio[loudest]),
            high=NOISY,
            where=place(first, loudest),
        )
        yield Measurement(
            f"{kind}: times the data sheet, least",
            float(ratio[quietest]),
            low=QUIET,
            where=place(first, quietest),
        )


@TOPIC.check
def new_samples(bench: Bench) -> Iterator[Measurement]:
    """Every scan has a new sample: no more readings are equal to those of the scan before than noise of this
    size makes so by chance. A part that samples too slowly, or is not asked to, repeats itself."""
    readings = bench.at_rest()
    for kind, first in (("accelerometers", 0), ("magnetometers", 1)):
        worst, excess = -1.0, None
        for slot in range(first, readings.counts.shape[1], 2):
            counts = readings.counts[readings.usable[:, slot], slot]
            if len(counts) < SCANS_MIN:
                continue
            same = float(np.mean(np.all(np.diff(counts, axis=0) == 0, axis=1)))
            part, lsb = int(bench.info.slots.part[slot]), float(readings.lsb[slot])
            allowed = max(REPEATED, 3 * by_chance(data_sheet_noise(part, readings.rate_hz, lsb), lsb))
            if same / allowed > worst:
                worst = same / allowed
                excess = Measurement(
                    f"{kind}: repeated, most", 100 * same, "%", high=100 * allowed, where=f"slot {slot}"
                )
        yield excess or Measurement(f"{kind}: repeated, most", float("nan"), "%", high=100 * REPEATED)


def noise_ratio(readings: Readings, parts: NDArray[np.uint8], axes: NDArray[np.uint8], first: int) -> Array:
    """(s, 3) scatter over that of the data sheet of every second slot; NaN for axes not used or not known."""
    slots = range(first, readings.counts.shape[1], 2)
    ratio = np.full((len(slots), 3), np.nan)
    for place_, slot in enumerate(slots):
        counts = readings.counts[readings.usable[:, slot], slot]
        if len(counts) >= SCANS_MIN:
            lsb = float(readings.lsb[slot])
            scatter = without_drift(counts).std(axis=0) * lsb
            used = [bool(axes[slot] >> axis & 1) for axis in range(3)]
            expected = data_sheet_noise(int(parts[slot]), readings.rate_hz, lsb)
            ratio[place_] = np.where(used, scatter / expected, np.nan)
    return ratio


def no_readings(readings: Readings, first: int) -> Iterator[str]:
    """Slots of a kind with too few usable readings to say anything."""
    for slot in range(first, readings.counts.shape[1], 2):
        if int(readings.usable[:, slot].sum()) < SCANS_MIN:
            yield f"slot {slot}"


def by_chance(sigma: float, lsb: float) -> float:
    """How often all three axes have the same counts twice, of normal noise; NaN if that is not known."""
    width = 2.0 * np.sqrt(np.pi) * sigma
    return float(min(1.0, lsb / width) ** 3) if width > 0 else float("nan")


def place(first: int, index: tuple[np.intp, ...]) -> str:
    """The slot and axis of an entry of noise_ratio()."""
    return f"slot {first + 2 * int(index[0])} {'xyz'[int(index[1])]}"
