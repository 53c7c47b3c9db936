"""Recordings as arrays: when scans were, and what sensors read while a ribbon lay still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from ribbonhost.clock import extend_us
from ribbonhost.wire import Info, Orient, OrientCompact, Raw, SlotReason, sigma_rad

from ribbonhil.check.check import NotRunError
from ribbonhil.conformance.device import Recording

Array = NDArray[np.float64]
ScanKind = type[Orient] | type[OrientCompact] | type[Raw]

SEQUENCE_MODULUS = 1 << 16
PARTS_OF_A_REST = 4
"""A ribbon at rest reads the same on average in each quarter of a recording ..."""
REST_MPS2 = 0.03
"""... within this: 0.17 degrees. Some that wander are faulty; when half of them do, the ribbon moves."""
SCANS_MIN = 20


@dataclass(frozen=True)
class Scans:
    """Scans in the order in which they came, (n,) each: number, device time (us), host time of arrival (s).

    Numbers and device times go on where their counters wrap.
    """

    number: NDArray[np.int64]
    t_us: NDArray[np.int64]
    arrival_s: Array


def scans_of(recording: Recording, kind: ScanKind) -> Scans:
    """The scans of all packets of one kind."""
    number: list[int] = []
    t_us: list[int] = []
    arrival_s: list[float] = []
    for frame, packet in recording.of(kind):
        before, before_us = (number[-1], t_us[-1]) if number else (packet.sequence, packet.t_us)
        step = (packet.sequence - before + SEQUENCE_MODULUS // 2) % SEQUENCE_MODULUS
        number.append(before + step - SEQUENCE_MODULUS // 2)
        t_us.append(extend_us(packet.t_us, before_us))
        arrival_s.append(frame.t_host_s)
    return Scans(np.array(number, np.int64), np.array(t_us, np.int64), np.array(arrival_s))


@dataclass(frozen=True)
class Readings:
    """T scans of S slots and N nodes.

    Attributes:
        rate_hz: scans a second.
        counts: (T, S, 3) as read, frame of the part.
        usable: (T, S) whether the counts are a reading: the reason is ok, or out_of_range, which says that a
            calibration does not fit.
        lsb: (S,) m/s^2 or uT a count; slots 0, 2, 4 ... are accelerometers.
        q_world_node: (U, N, 4) of the U scans whose ORIENT came.
        valid: (U, N).
        sigma_rad: (U, N) as the device states it, NaN where it is not known.
        flags: (U, N) the upper four bits of quality.
    """

    rate_hz: int
    counts: Array
    usable: NDArray[np.bool_]
    lsb: Array
    q_world_node: Array
    valid: NDArray[np.bool_]
    sigma_rad: Array
    flags: NDArray[np.uint8]

    def mean(self, slots: slice) -> Array:
        """(s, 3) mean readings of some slots, m/s^2 or uT, frame of the part; NaN for one that has none."""
        return _mean(self.counts[:, slots], self.usable[:, slots]) * self.lsb[slots, None]

    def wander(self, slots: slice) -> Array:
        """(s,) by how much the means of the quarters differ at most, m/s^2 or uT; NaN without readings."""
        quarters = zip(
            np.array_split(self.counts[:, slots], PARTS_OF_A_REST),
            np.array_split(self.usable[:, slots], PARTS_OF_A_REST),
            strict=True,
        )
        means = np.stack([_mean(counts, usable) for counts, usable in quarters])
        differences = np.linalg.norm(means[:, None] - means[None], axis=-1)
        return np.asarray(differences.max(axis=(0, 1)) * self.lsb[slots])

    def moved(self) -> str:
        """How much the ribbon moved, in words; empty if it was at rest."""
        wander = self.wander(slice(0, None, 2))
        known = wander[np.isfinite(wander)]
        if not len(known):
            raise NotRunError("no accelerometer gives readings")
        middle = float(np.median(known))
        return (
            f"by {middle:.3f} m/s^2 in {len(self.counts) / self.rate_hz:.1f} s" if middle > REST_MPS2 else ""
        )


def _mean(counts: Array, usable: NDArray[np.bool_]) -> Array:
    """(S, 3) means over usable scans; NaN for a slot without any."""
    count = usable.sum(axis=0)[:, None]
    total = np.sum(counts, axis=0, where=usable[..., None])
    return np.asarray(np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0))


def readings_of(recording: Recording, info: Info) -> Readings:
    """The readings of a recording. Raises NotRunError if there are too few."""
    slots, nodes = len(info.slots), info.node_count
    raws = [raw for _, raw in recording.of(Raw) if len(raw.accels) + len(raw.mags) == slots]
    orients = [orient for _, orient in recording.of(Orient) if len(orient.nodes) == nodes]
    if min(len(raws), len(orients)) < SCANS_MIN or nodes == 0:
        raise NotRunError(f"{len(raws)} RAW and {len(orients)} ORIENT packets came, {SCANS_MIN} are needed")
    counts = np.zeros((len(raws), slots, 3))
    reasons = np.zeros((len(raws), slots), np.uint8)
    for scan, raw in enumerate(raws):
        counts[scan, ::2], counts[scan, 1::2] = raw.accels.counts, raw.mags.counts
        reasons[scan, ::2], reasons[scan, 1::2] = raw.accels.reason, raw.mags.reason
    quality = np.stack([orient.nodes.quality for orient in orients])
    return Readings(
        rate_hz=recording.rate_hz,
        counts=counts,
        usable=np.isin(reasons, (SlotReason.OK, SlotReason.OUT_OF_RANGE)),
        lsb=np.asarray(info.slots.lsb, np.float64),
        q_world_node=np.stack([orient.nodes.q_world_node for orient in orients]),
        valid=np.stack([orient.nodes.valid for orient in orients]),
        sigma_rad=sigma_rad(quality),
        flags=(quality >> 4).astype(np.uint8),
    )
