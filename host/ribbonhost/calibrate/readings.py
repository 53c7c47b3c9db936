"""RAW packets of one ribbon as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.calibrate.sensor_errors import Array

US_WRAP = 1 << 32
SEQUENCE_WRAP = 1 << 16


@dataclass(frozen=True)
class Readings:
    """All that a ribbon read in T scans, in SI units of the uncalibrated parts.

    t_s: (T,) device time from the first scan. accel_mps2: (T, A, 3), accel_reason: (T, A) wire.SlotReason;
    field_ut: (T, M, 3), field_reason: (T, M). scan: (T,) number of the scan, which counts those that were
    lost too. rate_hz: as the device was told. accel_lsb_mps2, field_lsb_ut: one count.
    """

    t_s: Array
    accel_mps2: Array
    accel_reason: NDArray[np.uint8]
    field_ut: Array
    field_reason: NDArray[np.uint8]
    scan: NDArray[np.int64]
    rate_hz: float
    accel_lsb_mps2: float
    field_lsb_ut: float

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def lost(self) -> int:
        """Scans that never came."""
        return int(self.scan[-1] - self.scan[0] + 1 - len(self)) if len(self) else 0


def readings_of(info: wire.Info, raws: Sequence[wire.Raw], rate_hz: float | None = None) -> Readings:
    """The readings of RAW packets in the order in which they came; those of other lengths are left out.

    rate_hz: if it is not that of INFO.
    """
    accels, mags = len(info.slots.lsb[0::2]), len(info.slots.lsb[1::2])
    raws = [raw for raw in raws if len(raw.accels.reason) == accels and len(raw.mags.reason) == mags]
    lsb = np.asarray(info.slots.lsb, dtype=np.float64)
    t_us = np.unwrap(np.array([raw.t_us for raw in raws], dtype=np.float64), period=US_WRAP)
    scan = np.unwrap(np.array([raw.sequence for raw in raws], dtype=np.float64), period=SEQUENCE_WRAP)
    accel = np.array([raw.accels.counts for raw in raws], dtype=np.float64).reshape(-1, accels, 3)
    field = np.array([raw.mags.counts for raw in raws], dtype=np.float64).reshape(-1, mags, 3)
    return Readings(
        t_s=(t_us - (t_us[0] if len(t_us) else 0.0)) * 1e-6,
        accel_mps2=accel * lsb[0::2, None],
        accel_reason=np.array([raw.accels.reason for raw in raws], dtype=np.uint8).reshape(-1, accels),
        field_ut=field * lsb[1::2, None],
        field_reason=np.array([raw.mags.reason for raw in raws], dtype=np.uint8).reshape(-1, mags),
        scan=scan.astype(np.int64),
        rate_hz=float(rate_hz or info.rate_hz),
        accel_lsb_mps2=float(lsb[0::2].max(initial=0.0)),
        field_lsb_ut=float(lsb[1::2].max(initial=0.0)),
    )


def mended(readings: Readings) -> tuple[Readings, NDArray[np.bool_]]:
    """The readings with those that are none replaced by the sensor's last (or first) good one; and which were
    good (T, A + M).

    What only does not fit in with its neighbours is a reading: sensors that are not calibrated do not.
    """
    usable = (wire.SlotReason.OK, wire.SlotReason.OUT_OF_RANGE)
    accel_good, field_good = np.isin(readings.accel_reason, usable), np.isin(readings.field_reason, usable)
    return (
        replace(
            readings,
            accel_mps2=_held(readings.accel_mps2, accel_good),
            field_ut=_held(readings.field_ut, field_good),
        ),
        np.concatenate([accel_good, field_good], axis=1),
    )


def _held(values: Array, good: NDArray[np.bool_]) -> Array:
    if good.all() or len(good) == 0:
        return values
    last = np.maximum.accumulate(np.where(good, np.arange(len(good))[:, None], -1), axis=0)
    last = np.where(last < 0, np.argmax(good, axis=0), last)
    return np.asarray(np.take_along_axis(values, last[..., None], axis=0))
