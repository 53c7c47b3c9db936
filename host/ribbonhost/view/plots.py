"""Quantities of each ribbon over time."""

import math
import threading

import numpy as np

from ribbonhost.pipeline.report import Report
from ribbonhost.view.layout import Float64, Layout, Moment
from ribbonhost.view.ring import Ring
from ribbonhost.view.shading import node_error_m, node_radius_m

STEP_S = 0.1
ROWS = 3000
POINTS = 400
"""Of a line in the page."""

WINDOW_S = 60.0
"""What is shown of a stream."""

NAMES = (
    "height of the tip, mm",
    "uncertainty of the tip, mm",
    "error, mean of the nodes, mm",
    "frames per second",
    "frames lost",
    "latency, median, ms",
    "temperature, °C",
)
ERROR = NAMES[2]


class Plots:
    """Rows of all quantities of all ribbons; one thread may add while another reads."""

    def __init__(self, layout: Layout, *, thins: bool) -> None:
        self._layout = layout
        self._ring = Ring(ROWS, thins=thins)
        self._lock = threading.Lock()
        self._t_s = np.full(ROWS, np.nan)
        self._values = np.full((ROWS, len(NAMES), len(layout.labels)), np.nan, np.float32)
        self._reported = np.full((4, len(layout.labels)), np.nan)
        self._due_s = -math.inf

    def report(self, report: Report) -> None:
        """What the devices' reports say, for all rows from now on."""
        for ribbon, said in enumerate(report.ribbons):
            self._reported[:, ribbon] = (
                said.frames_per_s,
                said.counters.lost,
                said.latency_p50_s * 1e3,
                math.nan if said.temperature_c is None else said.temperature_c,
            )

    def add(self, moment: Moment) -> None:
        """A row of a moment, if it is time for one."""
        if moment.t_s < self._due_s:
            return
        self._due_s = max(self._due_s + STEP_S, moment.t_s)
        tips = [at.stop - 1 for at in self._layout.slices]
        error_m = node_error_m(moment)
        measured = np.array(
            [
                moment.node_m[tips, 2] * 1e3,
                node_radius_m(self._layout, moment)[tips] * 1e3,
                [error_m[at].mean() * 1e3 for at in self._layout.slices],
            ]
        )
        with self._lock:
            place = self._ring.next(self._t_s, self._values)
            if place is not None:
                self._t_s[place] = moment.t_s
                self._values[place] = np.concatenate([measured, self._reported])

    def lines(self, name: str, window_s: float | None) -> tuple[Float64, dict[int, Float64]]:
        """Times, and the values of each ribbon that has any; at most POINTS of each, none of them NaN.

        window_s: the last seconds. Where a ribbon has no value, its line stays where it was.
        """
        with self._lock:
            places = self._ring.places()
            t_s, values = self._t_s[places], self._values[places, NAMES.index(name)].astype(np.float64)
        if window_s is not None and len(t_s):
            recent = t_s > t_s[-1] - window_s
            t_s, values = t_s[recent] - t_s[-1], values[recent]
        step = max(1, math.ceil(len(t_s) / POINTS))
        t_s, values = t_s[::step], values[::step]
        if len(t_s) < 2:
            return np.array([0.0, 1.0]), {}
        return t_s, {ribbon: _held(line) for ribbon, line in enumerate(values.T) if np.isfinite(line).any()}


def _held(line: Float64) -> Float64:
    """NaN replaced by the value before, or at the begin by the first."""
    known = np.flatnonzero(np.isfinite(line))
    before = np.searchsorted(known, np.arange(len(line)), side="right") - 1
    return line[known[np.maximum(before, 0)]]
