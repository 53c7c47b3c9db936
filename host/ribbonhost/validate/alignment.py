"""Finds the time offset and the rigid motion between two measurements of the same moving points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from ribbonhost.errors import ValidationError

Array = NDArray[np.float64]

MIN_OVERLAP = 0.5
COARSE_STEPS = 401
COARSE_FRAMES = 150


@dataclass(frozen=True)
class Alignment:
    """truth(t + offset_s) = rotation @ measured(t) + translation_m, in the least squares sense.

    rotation (3, 3): truth frame from measured frame. rms_m: what is left, over all points and frames used.
    offset_sigma_s: standard deviation of the offset, from the curvature of the squared residual.
    """

    offset_s: float
    rotation: Array
    translation_m: Array
    rms_m: float
    offset_sigma_s: float

    def apply(self, p_m: Array) -> Array:
        """Measured points (..., 3) in the frame of the truth."""
        return np.asarray(p_m @ self.rotation.T + self.translation_m)


def rigid_motion(p_m: Array, q_m: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) that take points p (K, 3) nearest to points q (K, 3), both in
    metres.

    Kabsch, Acta Cryst. A32 (1976) 922. Raises ValidationError for fewer than 3 points or points on one line,
    which leave a rotation open.
    """
    if len(p_m) < 3:
        raise ValidationError(f"{len(p_m)} common points do not fix a rigid motion: at least 3 are needed")
    p0, q0 = p_m.mean(axis=0), q_m.mean(axis=0)
    u, singular, vt = np.linalg.svd((p_m - p0).T @ (q_m - q0))
    if singular[1] <= 1e-9 * max(singular[0], 1e-30):
        raise ValidationError(
            "all points lie on one line: a rotation about it stays unknown, mark more points"
        )
    d = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u @ d @ vt).T
    return rotation, q0 - rotation @ p0


class _Truth:
    """Truth positions at any time: cubic in time, NaN where the optical system saw nothing within one
    frame."""

    def __init__(self, t_s: Array, p_m: Array) -> None:
        self.t_s = t_s
        seen: NDArray[np.bool_] = np.asarray(np.isfinite(p_m).all(axis=2))
        self.seen = seen
        filled = p_m.copy()
        for k in range(p_m.shape[1]):
            if seen[:, k].sum() < 4:
                continue
            for axis in range(3):
                filled[:, k, axis] = np.interp(t_s, t_s[seen[:, k]], p_m[seen[:, k], k, axis])
        self.lost = seen.sum(axis=0) < 4
        filled[:, self.lost] = 0.0
        self.spline = CubicSpline(t_s, filled, axis=0)

    def at(self, t_s: Array) -> Array:
        p = np.asarray(self.spline(t_s))
        right = np.clip(np.searchsorted(self.t_s, t_s), 1, len(self.t_s) - 1)
        seen = self.seen[right] & self.seen[right - 1] & ~self.lost
        seen &= ((t_s >= self.t_s[0]) & (t_s <= self.t_s[-1]))[:, None]
        p[~seen] = np.nan
        return p


def align(
    t_s: Array,
    p_m: Array,
    truth_t_s: Array,
    truth_m: Array,
    *,
    max_offset_s: float = 5.0,
    offset_s: float | None = None,
) -> Alignment:
    """Time offset and rigid motion between measured points and the truth of the same points.

    t_s (T,), p_m (T, K, 3) measured; truth_t_s (U,), truth_m (U, K, 3), NaN where nothing was seen. Both
    times are seconds of their own clocks, increasing. The offset within +-max_offset_s is searched on a grid
    and refined, with the best rigid motion for each candidate; give offset_s when it is known.

    Raises ValidationError when the two hardly overlap, or nothing moves so that no offset can be seen.
    """
    truth = _Truth(truth_t_s, truth_m)
    valid: NDArray[np.bool_] = np.asarray(np.isfinite(p_m).all(axis=2))

    def pairs(offset: float, step: int = 1) -> tuple[Array, Array]:
        q = truth.at(t_s[::step] + offset)
        both = valid[::step] & np.isfinite(q).all(axis=2)
        return p_m[::step][both], q[both]

    def mean_square(offset: float, step: int = 1) -> float:
        p, q = pairs(offset, step)
        if len(p) < MIN_OVERLAP * valid[::step].sum():
            return np.inf
        rotation, translation = rigid_motion(p, q)
        return float(np.mean(np.sum((p @ rotation.T + translation - q) ** 2, axis=1)))

    sigma_s = 0.0
    if offset_s is None:
        offset_s, sigma_s = _best_offset(
            mean_square, max_offset_s, int(valid.sum()), max(1, len(t_s) // COARSE_FRAMES)
        )
    elif not np.isfinite(mean_square(offset_s)):
        raise ValidationError("recording and truth hardly overlap in time: check the offset given")
    p, q = pairs(offset_s)
    rotation, translation = rigid_motion(p, q)
    rms = float(np.sqrt(np.mean(np.sum((p @ rotation.T + translation - q) ** 2, axis=1))))
    return Alignment(offset_s, rotation, translation, rms, sigma_s)


def _best_offset(
    mean_square: Callable[[float, int], float], max_offset_s: float, n_points: int, coarse_step: int
) -> tuple[float, float]:
    """The offset of least mean square residual, and its standard deviation."""
    grid = np.linspace(-max_offset_s, max_offset_s, COARSE_STEPS)
    values = np.array([mean_square(float(offset), coarse_step) for offset in grid])
    if not np.isfinite(values).any():
        raise ValidationError(
            f"recording and truth hardly overlap within +-{max_offset_s:g} s: check their times"
        )
    best = int(np.argmin(values))
    finite = values[np.isfinite(values)]
    if finite.max() - finite.min() < 1e-4 * max(finite.max(), 1e-16):
        raise ValidationError("nothing moves: no time offset can be seen, record a motion or give the offset")
    step = float(grid[1] - grid[0])
    found = minimize_scalar(
        lambda offset: mean_square(offset, 1),
        bounds=(grid[best] - step, grid[best] + step),
        method="bounded",
        options={"xatol": 1e-6},
    )
    offset = float(found.x)
    h = step / 4
    curvature = (mean_square(offset + h, 1) - 2 * float(found.fun) + mean_square(offset - h, 1)) / h**2
    sigma = (
        float(np.sqrt(2 * float(found.fun) / max(n_points * curvature, 1e-30)))
        if np.isfinite(curvature)
        else np.nan
    )
    return offset, sigma
