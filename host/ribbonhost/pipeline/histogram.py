"""Quantiles of any number of durations in a fixed amount of memory."""

import math

SMALLEST_S = 1e-6
LARGEST_S = 100.0
RATIO = 1.02
"""Of neighbouring bin borders: a quantile is within 1 % of the sample that it stands for."""

_BINS = math.ceil(math.log(LARGEST_S / SMALLEST_S) / math.log(RATIO)) + 1


class Histogram:
    """Counts durations in bins of equal ratio; those outside the range count in the outermost bins."""

    def __init__(self) -> None:
        self.count = 0
        self._bins = [0] * _BINS

    def add(self, duration_s: float) -> None:
        """Counts one duration; NaN is not counted."""
        if math.isnan(duration_s):
            return
        within_s = min(max(duration_s, SMALLEST_S), LARGEST_S)
        self._bins[int(math.log(within_s / SMALLEST_S) / math.log(RATIO))] += 1
        self.count += 1

    def quantile_s(self, share: float) -> float:
        """The duration that this share of all does not exceed; NaN if none was counted."""
        rank = max(1, math.ceil(share * self.count))
        for place, count in enumerate(self._bins):
            rank -= count
            if rank <= 0 and self.count:
                return float(SMALLEST_S * RATIO ** (place + 0.5))
        return math.nan
