"""Motion while it happens: causal, or with a lag of up to 0.2 s that makes it smoother."""

from collections.abc import Sequence

from ribbonhost.motion.model import Float64, Motion, MotionParams, Samples, join
from ribbonhost.motion.sharing import Helpers
from ribbonhost.motion.tracker import Tracker, follow_each

LAG_MAX_S = 0.2
BATCH = 64
"""Samples taken at once."""


class LiveMotion:
    """Estimates the motion of one ribbon from its scans as they come. Not for several threads at once.

    Starts by itself, at rest or in motion, and again when lost.
    """

    def __init__(self, params: MotionParams, *, lag_samples: int = 0) -> None:
        """lag_samples: how many samples later than its own an estimate is made.

        Raises ValueError for parameters that cannot be, or a negative lag.
        """
        if lag_samples < 0:
            raise ValueError(f"a lag of {lag_samples} samples is none")
        self._lag = lag_samples
        self._tracker = Tracker(params, lag_samples + (1 if lag_samples else BATCH))

    @property
    def counters(self) -> dict[str, int]:
        """Samples taken; how often it started again; outliers among the sensors; samples refused."""
        return self._tracker.counters

    @property
    def scales(self) -> dict[str, float]:
        """Variances found from the samples, in units of the parameters'."""
        return self._tracker.scales

    def update(self, samples: Samples) -> Motion | None:
        """Takes the next samples and returns the motion at those that are due, None if there are none.

        Without a lag these are the samples given; with one, as many earlier ones. Their covariance is then
        that of the estimate without lag: cautious. Raises ValueError if the times do not increase.
        """
        tracker, due = self._tracker, []
        step = 1 if self._lag else BATCH
        for first in range(0, len(samples), step):
            tracker.extend(samples[first : first + step])
            ready = tracker.count - self._lag
            if ready > 0:
                due.append(tracker.smoothed_mean(0) if self._lag else tracker.filtered(0, ready))
                tracker.forget(ready)
        return join(due) if due else None


def update_each(
    ribbons: Sequence[LiveMotion], samples: Samples, ahead_s: Float64, helpers: Helpers
) -> Motion:
    """Takes the next sample of each of several ribbons of as many nodes; estimates the motion ahead of it.

    Row i of the samples and of the motion is of ribbons[i]; the ribbons are shared by threads. ahead_s: (R,)
    not negative, by which the motion is carried on from the sample. Raises ValueError for arrays that cannot
    be, and if a ribbon's times do not increase.
    """
    return follow_each([ribbon._tracker for ribbon in ribbons], samples, ahead_s, helpers)
