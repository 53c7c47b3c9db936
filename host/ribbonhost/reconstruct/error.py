"""The error figure of the field: the mean distance of sensors as a share of the ribbon's length."""

import numpy as np

from ribbonhost.reconstruct.arguments import Float64


def error_percent(p_m: Float64, truth_m: Float64, length_m: float) -> float:
    """E = 100 mean(|p - truth|) / length, percent, over all points.

    Source: Sprynski, Lacolle, Biard 2011, section 4.2.

    p_m, truth_m: (..., 3) of one shape, same frame: the ribbons of a comb without its reference, (R, n, 3).
    Raises ValueError for shapes that differ or a length that is not positive; NaN positions make E NaN.
    """
    if p_m.shape != truth_m.shape or p_m.shape[-1:] != (3,):
        raise ValueError(f"p_m and truth_m must have one shape (..., 3), not {p_m.shape} and {truth_m.shape}")
    if not length_m > 0:
        raise ValueError(f"length_m must be a positive length, not {length_m}")
    return float(100.0 * np.linalg.norm(p_m - truth_m, axis=-1).mean() / length_m)
