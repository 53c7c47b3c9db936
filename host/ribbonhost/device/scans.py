"""From ORIENT packets to scans with host times; what cannot be is counted and kept out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.clock import DeviceClock
from ribbonhost.device.counters import Counts

AHEAD_S = 0.05
"""A scan that seems to end so long after its frame arrived has an absurd time."""

BEHIND_S = 3.0
"""So has one that seems to have ended so long before: no link holds frames back for longer."""


@dataclass(frozen=True, slots=True)
class Scan:
    """All orientations of one scan, and its readings where the device sends them.

    Attributes:
        sequence: as on the wire.
        t_device_us: device time of the end of the scan, 64-bit extension.
        t_host_s: the same on the host's clock, by the estimate of the moment.
        t_arrival_s: when the host had read its last byte, that of RAW where it came.
        q_world_node: (n, 4) unit; of invalid nodes without meaning.
        valid: (n,) bool.
        quality: (n,) uint8 as on the wire.
        raw: the readings; None if they did not come.
    """

    sequence: int
    t_device_us: int
    t_host_s: float
    t_arrival_s: float
    q_world_node: NDArray[np.float64]
    valid: NDArray[np.bool_]
    quality: NDArray[np.uint8]
    raw: wire.Raw | None = None


class ScanReader:
    """Checks the ORIENT packets of one device and gives them their time.

    Attributes:
        rate_hz: scans a second, as last set or told.
    """

    def __init__(self, clock: DeviceClock, counts: Counts) -> None:
        self.rate_hz = 0.0
        self._clock = clock
        self._counts = counts
        self._sequence: int | None = None
        self._t_device_us = 0

    def restart(self) -> None:
        """The device was reset: its sequence starts anew."""
        self._sequence = None

    def read(
        self, orient: wire.Orient | wire.OrientCompact, node_count: int, t_arrival_s: float
    ) -> Scan | None:
        """The scan, or None, counted, if it cannot be used. `node_count`: what INFO says."""
        nodes = orient.nodes
        if len(nodes) != node_count:
            self._counts.add("wrong_node_count")
            return None
        t_device_us = self._clock.extend(orient.t_us, t_arrival_s)
        if not self._clock.synced:
            self._counts.add("untimed")
            return None
        t_host_s = self._clock.t_host_s(t_device_us)
        if not t_arrival_s - BEHIND_S < t_host_s < t_arrival_s + AHEAD_S:
            self._counts.add("clock_jumps")
            return None
        if not self._follows(orient.sequence, t_device_us):
            return None
        self._counts.add("frames")
        self._counts.add("invalid_nodes", node_count - int(np.count_nonzero(nodes.valid)))
        return Scan(
            orient.sequence,
            t_device_us,
            t_host_s,
            t_arrival_s,
            nodes.q_world_node,
            nodes.valid,
            nodes.quality,
        )

    def _follows(self, sequence: int, t_device_us: int) -> bool:
        """Counts what is missing since the scan before; False if this one is not to be used."""
        if self._sequence is not None:
            step = (sequence - self._sequence) % (1 << 16)
            elapsed_us = t_device_us - self._t_device_us
            if step == 0:
                self._counts.add("repeated")
                return False
            if elapsed_us <= 0:
                self._counts.add("clock_jumps")
                return False
            periods = max(1, round(elapsed_us * 1e-6 * self.rate_hz))
            # A phase that was moved, or a rate that was changed, shifts a few frames.
            if step - periods > 2 + periods // 10:
                self._counts.add("sequence_jumps")
                step = periods
            self._counts.add("lost", step - 1)
        self._sequence = sequence
        self._t_device_us = t_device_us
        return True
