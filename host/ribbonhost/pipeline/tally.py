"""What is measured of reconstructed frames, in a fixed amount of memory."""

import math
import time
from collections.abc import Callable

from ribbonhost.device import Scan
from ribbonhost.pipeline.histogram import Histogram


class Tally:
    """Counts and distributions since it was made; written by one thread.

    Attributes:
        frames: moments that were reconstructed.
        surfaces: of them, those with a surface.
        lambda_limited: transversals held at their smallest tangent.
        unsolved: frames that could not be reconstructed.
        latency: from the end of the oldest scan of a frame to the result in memory.
        age: from the moment that a frame shows to the result in memory: the latency, and, two-sided,
            how old the readings are at the end of their scan.
        ribbon_latency: the same as latency for the scans of each ribbon.
        scan_spread: how far apart the scans of a frame ended.
    """

    def __init__(self, ribbons: int, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self.t_start_s = now_s()
        self.cpu_start_s = time.process_time()
        self.frames = 0
        self.surfaces = 0
        self.lambda_limited = 0
        self.unsolved = 0
        self.latency = Histogram()
        self.age = Histogram()
        self.scan_spread = Histogram()
        self.ribbon_latency = [Histogram() for _ in range(ribbons)]
        self._errors = 0
        self._error_sum = 0.0
        self._error_min = math.inf
        self._error_max = -math.inf

    def add_frame(self, t_host_s: float, scans: dict[int, Scan]) -> None:
        """Counts a frame of a moment, made of these scans, by the place of their ribbon, that is done."""
        t_done_s = self._now_s()
        self.frames += 1
        ends_s = [scan.t_host_s for scan in scans.values()]
        self.latency.add(t_done_s - min(ends_s))
        self.age.add(t_done_s - t_host_s)
        if len(ends_s) > 1:
            self.scan_spread.add(max(ends_s) - min(ends_s))
        for place, scan in scans.items():
            self.ribbon_latency[place].add(t_done_s - scan.t_host_s)

    def add_error(self, percent: float) -> None:
        """Counts the E of a frame; NaN is not counted."""
        if not math.isnan(percent):
            self._errors += 1
            self._error_sum += percent
            self._error_min = min(self._error_min, percent)
            self._error_max = max(self._error_max, percent)

    @property
    def error_percent(self) -> tuple[float, float, float]:
        """Mean, smallest and largest E; NaN if none was counted."""
        if not self._errors:
            return math.nan, math.nan, math.nan
        return self._error_sum / self._errors, self._error_min, self._error_max

    @property
    def cpu_percent(self) -> float:
        """CPU time of this process since it was made, percent of one core."""
        elapsed_s = self._now_s() - self.t_start_s
        return 100.0 * (time.process_time() - self.cpu_start_s) / elapsed_s if elapsed_s > 0 else math.nan
