"""Where ribbons start on the reference: what is known along it, there."""

from collections.abc import Sequence

import numpy as np

from ribbonhost.motion.model import Float64


def start_weights(node_count: int, pitch_m: float, start_m: Sequence[float]) -> Float64:
    """(R, n) weights that interpolate from the n nodes of the reference to where R ribbons start on it.

    Linear along the arc length; what is interpolated is 0 at the reference's anchor.
    """
    s_m = pitch_m * np.arange(1, 2 * node_count, 2)
    starts = np.clip(np.asarray(start_m, dtype=np.float64), 0.0, s_m[-1])
    nodes = np.eye(node_count)
    return np.stack(
        [np.interp(starts, np.r_[0.0, s_m], np.r_[0.0, nodes[:, k]]) for k in range(node_count)], axis=1
    )
