"""How far reconstructed nodes are from where they truly were."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbonhost.errors import ValidationError
from ribbonhost.validate.alignment import Alignment, align
from ribbonhost.validate.truth import Truth

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Comparison:
    """T frames of R ribbons of n nodes against the truth, after the alignment.

    t_s: (T,) seconds of the recording. distance_m: (T, R, n) |p~ - p|; NaN where the truth saw nothing.
    error_percent: (T,) E(t) of the paper; NaN where no node was seen. names: of the ribbons.
    measured_m, truth_m: (T, R, n, 3) in the frame of the truth.
    """

    alignment: Alignment
    names: tuple[str, ...]
    t_s: Array
    distance_m: Array
    error_percent: Array
    measured_m: Array
    truth_m: Array

    @property
    def node_mean_m(self) -> Array:
        """(R, n) mean distance of each node; NaN of one that was never seen."""
        return _mean(self.distance_m, 0)

    @property
    def rotation_deg(self) -> float:
        """Angle of the alignment's rotation."""
        return float(np.degrees(np.arccos(np.clip((np.trace(self.alignment.rotation) - 1) / 2, -1, 1))))

    def error_range(self) -> tuple[float, float, float]:
        """E: mean, smallest and largest over the frames, percent."""
        e = self.error_percent[np.isfinite(self.error_percent)]
        return float(e.mean()), float(e.min()), float(e.max())


def compare(
    t_s: Array,
    node_m: Array,
    truth: Truth,
    *,
    names: tuple[str, ...],
    length_m: float,
    is_comb: bool,
    offset_s: float | None = None,
    max_offset_s: float = 5.0,
) -> Comparison:
    """Aligns the recording with the truth and measures what is left.

    t_s (T,), node_m (T, R, n, 3), NaN where there is nothing; length_m: L of a ribbon. In a comb, the
    reference, index 0, helps to align, and E(t) = 100 / ((n + 1) N L) sum |p~ - p| is over the N others
    (Sprynski, Lacolle, Biard 2011, section 4.2; the paper counts nodes 0 to n); nodes that the truth did not
    see are left out of the mean. offset_s: the time offset if it is known.

    Raises ValidationError if the two do not overlap, nothing moves, or too little was seen.
    """
    frames, ribbons, nodes, _ = node_m.shape
    points = ribbons * nodes
    found = align(
        t_s,
        node_m.reshape(frames, points, 3),
        truth.t_s,
        truth.node_m.reshape(len(truth.t_s), points, 3),
        offset_s=offset_s,
        max_offset_s=max_offset_s,
    )
    truth_m = truth_at(truth, t_s + found.offset_s)
    measured_m = found.apply(node_m)
    distance_m = np.linalg.norm(measured_m - truth_m, axis=-1)
    counted = distance_m[:, 1:] if is_comb else distance_m
    error_percent = 100.0 * _mean(counted.reshape(frames, -1), 1) / length_m
    if not np.isfinite(error_percent).any():
        raise ValidationError("the truth saw no node of the ribbons that are counted")
    return Comparison(found, names, t_s, distance_m, error_percent, measured_m, truth_m)


def truth_at(truth: Truth, t_s: Array) -> Array:
    """(T, R, n, 3) linear between two instants that both saw the node, NaN elsewhere."""
    right = np.clip(np.searchsorted(truth.t_s, t_s), 1, len(truth.t_s) - 1)
    left = right - 1
    share = ((t_s - truth.t_s[left]) / (truth.t_s[right] - truth.t_s[left]))[:, None, None, None]
    between = (1 - share) * truth.node_m[left] + share * truth.node_m[right]
    between[(t_s < truth.t_s[0]) | (t_s > truth.t_s[-1])] = np.nan
    return np.asarray(between)


def _mean(values: Array, axis: int) -> Array:
    """Mean of what is finite; NaN of nothing."""
    seen = np.isfinite(values)
    count = seen.sum(axis=axis)
    total = np.where(seen, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
