"""The last minutes of a stream, or a whole recording, in a fixed amount of memory."""

import threading
from dataclasses import replace

import numpy as np

from ribbonhost.reconstruct.comb import Method
from ribbonhost.view.layout import Layout, Moment, Solver
from ribbonhost.view.ring import Ring

UNIT = 32767.0
"""What 1 is in a kept quaternion: 3e-5 rad are lost, less than the noise of any node."""


class History:
    """Moments that were kept; about 1.5 KiB each for six ribbons.

    Memory is taken, and touched, at once: it does not grow afterwards. One thread may add while others read.
    """

    def __init__(self, layout: Layout, capacity: int, method: Method, *, truth: bool, thins: bool) -> None:
        """thins: what is full becomes coarser instead of forgetting its oldest."""
        nodes = layout.node_count
        self._solver = Solver(layout, method)
        self._solving = threading.Lock()
        self._lock = threading.Lock()
        self._ring = Ring(capacity, thins=thins)
        # full, not zeros: pages that are first touched later would look like a leak.
        self._t_s = np.full(capacity, np.nan)
        self._q = np.full((capacity, nodes, 4), 1, np.int16)
        self._known = np.full((capacity, nodes), True)
        self._valid = np.full((capacity, nodes), True)
        self._sigma_rad = np.full((capacity, nodes), np.nan, np.float16)
        self._quality = np.full((capacity, nodes), 1, np.uint8)
        self._off_m = np.full((capacity if truth else 0, nodes, 3), np.nan, np.float16)

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the oldest and the newest moment; NaN if there is none."""
        with self._lock:
            if not self._ring.count:
                return np.nan, np.nan
            first, last = self._ring.place(0), self._ring.place(self._ring.count - 1)
            return float(self._t_s[first]), float(self._t_s[last])

    def add(self, moment: Moment) -> None:
        """Keeps a moment that is later than all before."""
        arrays = [self._t_s, self._q, self._known, self._valid, self._sigma_rad, self._quality]
        if len(self._off_m):
            arrays.append(self._off_m)
        with self._lock:
            place = self._ring.next(*arrays)
            if place is None:
                return
            self._t_s[place] = moment.t_s
            self._q[place] = np.rint(np.nan_to_num(moment.q_world_node) * UNIT)
            self._known[place], self._valid[place] = moment.known, moment.valid
            self._sigma_rad[place] = moment.sigma_rad
            self._quality[place] = moment.quality
            if len(self._off_m):
                self._off_m[place] = np.nan if moment.truth_m is None else moment.truth_m - moment.node_m

    def at(self, t_s: float) -> Moment | None:
        """The latest moment that is not later than t_s, or the oldest; None if there is none."""
        with self._lock:
            if not self._ring.count:
                return None
            place = self._ring.place(max(self._index(t_s), 0))
            when_s = float(self._t_s[place])
            q = self._q[place] / UNIT
            known, valid = self._known[place].copy(), self._valid[place].copy()
            sigma_rad, quality = self._sigma_rad[place].astype(np.float64), self._quality[place].copy()
            off_m = self._off_m[place].astype(np.float64) if len(self._off_m) else None
        length = np.linalg.norm(q, axis=-1, keepdims=True)
        q = np.where(length > 0.5, q / np.maximum(length, 0.5), (1.0, 0.0, 0.0, 0.0))
        with self._solving:
            moment = self._solver.solve(when_s, q, known, valid, sigma_rad, quality)
        return moment if off_m is None else replace(moment, truth_m=moment.node_m + off_m)

    def _index(self, t_s: float) -> int:
        """Of the latest moment that is not later."""
        low, high = 0, self._ring.count
        while low < high:
            middle = (low + high) // 2
            if self._t_s[self._ring.place(middle)] <= t_s:
                low = middle + 1
            else:
                high = middle
        return low - 1
