"""Motion over a recording, two-sided: every estimate from what came before and after it."""

from ribbonhost.motion.model import Motion, MotionParams, Samples, join
from ribbonhost.motion.tracker import Tracker

WINDOW = 300
OVERLAP = 150
"""Samples that a window looks ahead: after so many the past has been forgotten."""

LEARNING = 300
"""Samples gone over once before all else: their beginning, too, is then estimated with what they teach."""


def smooth_recording(samples: Samples, params: MotionParams) -> Motion:
    """The motion at all samples, estimated forward in one go and smoothed in windows that overlap.

    Memory does not grow with the length of the recording. Raises ValueError for parameters or arrays that
    cannot be, and if the times do not increase.
    """
    tracker = Tracker(params, WINDOW + OVERLAP)
    tracker.extend(samples[: min(LEARNING, tracker.capacity)])
    tracker.rewind()
    done = []
    for first in range(0, len(samples), WINDOW):
        tracker.extend(samples[first : first + WINDOW])
        if tracker.count > OVERLAP and first + WINDOW < len(samples):
            ready = tracker.count - OVERLAP
            done.append(tracker.smoothed(0, ready))
            tracker.forget(ready)
    done.append(tracker.smoothed(0, tracker.count))
    return join(done)
