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

    def lines(self, name: str, window_s: float | None) -> tuple[Float64, ...]:
        """Times, and the values of each ribbon at them; at most POINTS. window_s: the last seconds."""
        with self._lock:
            places = self._ring.places()
            t_s, values = self._t_s[places], self._values[places, NAMES.index(name)].astype(np.float64)
        if window_s is not None and len(t_s):
            recent = t_s > t_s[-1] - window_s
            t_s, values = t_s[recent] - t_s[-1], values[recent]
        step = max(1, math.ceil(len(t_s) / POINTS))
        if len(t_s) < 2:
            t_s, values = np.array([0.0, 1.0]), np.full((2, len(self._layout.labels)), np.nan)
        return (t_s[::step], *np.ascontiguousarray(values[::step].T))
