"""Puts the RAW of a scan beside its ORIENT."""

from dataclasses import replace

from ribbonhost import wire
from ribbonhost.device.counters import Counts
from ribbonhost.device.scans import Scan

LOST_MAX = 20
"""After so many scans without RAW none is waited for until one comes."""


class Pairing:
    """Holds a scan back until its RAW is there, as long as the device sends both.

    ORIENT comes first. A scan whose RAW is not there when the next ORIENT comes goes on without it: what was
    lost on the way costs one scan one period. So all depends on the packets and their order only.

    Attributes:
        expected: whether RAW is waited for: as the device said of its mode, and as it does.
    """

    def __init__(self, counts: Counts) -> None:
        self.expected = False
        self._lost_in_a_row = 0
        self._counts = counts
        self._waiting: Scan | None = None

    def expect(self, raw: bool) -> None:
        """The device said whether it sends RAW beside ORIENT."""
        self.expected = raw
        self._lost_in_a_row = 0

    def take(self, scan: Scan) -> list[Scan]:
        """Takes the next scan; returns those that wait no longer."""
        ready = self._give_up()
        if self.expected:
            self._waiting = scan
            return ready
        return [*ready, scan]

    def take_raw(self, raw: wire.Raw, node_count: int, t_arrival_s: float) -> list[Scan]:
        """Takes the next RAW; returns the scan that waited for it, if one did.

        One of another number of slots than two a node, or of another scan, is counted and not used.
        """
        scan = self._waiting
        self._lost_in_a_row = 0
        self.expected = True
        if scan is None or raw.sequence != scan.sequence or raw.t_us != scan.t_device_us % (1 << 32):
            return []
        if (len(raw.accels), len(raw.mags)) != (node_count, node_count):
            self._counts.add("wrong_node_count")
            return []
        self._waiting = None
        return [replace(scan, raw=raw, t_arrival_s=t_arrival_s)]

    def restart(self) -> None:
        """The device was reset, or is on another link: what waits will not be completed."""
        self._waiting = None

    def _give_up(self) -> list[Scan]:
        if self._waiting is None:
            return []
        scan, self._waiting = self._waiting, None
        self._counts.add("raw_lost")
        self._lost_in_a_row += 1
        self.expected = self._lost_in_a_row < LOST_MAX
        return [scan]
