"""The C solver once more in NumPy and SciPy: slow and by definitions, the oracle of its tests."""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, CubicSpline, KroghInterpolator
from scipy.optimize import brentq

from ribbonhost.reconstruct.arguments import Bool, Float64

LAMBDA_MIN = 0.05
PRECISE_RULE = np.polynomial.legendre.leggauss(64)


def unit(v: Float64) -> Float64:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def rotation(q: Float64) -> Float64:
    """(..., 3, 3) rotation matrices of quaternions (..., 4), scalar first."""
    w, x, y, z = np.moveaxis(unit(q), -1, 0)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def segment_length(p0: Float64, p1: Float64, t0: Float64, t1: Float64, h: float) -> float:
    """Arc length of the cubic Hermite segment with end derivatives t0, t1 by a parameter from 0 to h."""
    x, w = PRECISE_RULE
    u = (x[:, None] + 1) / 2
    slope = 6 * (u - u**2) * (p1 - p0) / h + (1 - 4 * u + 3 * u**2) * t0 + (3 * u**2 - 2 * u) * t1
    return float(h / 2 * (w @ np.linalg.norm(slope, axis=1)))


def segment_chord(t0: Float64, t1: Float64, h: float) -> Float64:
    """End minus start of the hermite method's segment: along t0 + t1, as far as makes the arc length h."""
    bisector = unit(t0 + t1)
    length = brentq(
        lambda a: segment_length(np.zeros(3), a * bisector, t0, t1, h) - h, h / 3, h * 1.001, xtol=1e-16
    )
    return length * bisector


def bridge(s: Float64, q: Float64, valid: Bool) -> Float64:
    """One ribbon: (n, 4) orientations with invalid nodes filled from valid ones; NaN if there are none."""
    at = np.flatnonzero(valid)
    if len(at) == 0:
        return np.full_like(q, np.nan)
    filled = q.copy()
    for k in np.flatnonzero(~valid):
        before, after = at[at < k], at[at > k]
        if len(before) and len(after):
            take = min(2, len(after)) if len(before) >= 2 else min(4 - len(before), len(after))
            near = np.concatenate([before[-(4 - take) :] if take < 2 else before[-2:], after[:take]])
            s_k = s[k]
        else:
            near = at[:2] if len(after) else at[-2:]
            reach = s[near[-1]] - s[near[0]]
            s_k = np.clip(s[k], s[near[0]] - reach, s[near[-1]] + reach)
        side = np.where(q[near] @ q[near[0]] < 0, -1.0, 1.0)
        filled[k] = unit(KroghInterpolator(s[near], side[:, None] * q[near])(s_k))
    return filled


def knots(s: Float64, tangent: Float64) -> tuple[Float64, Float64]:
    """Arc lengths and tangents of nodes and, before them, of the anchor s = 0 where it is not a node."""
    if s[0] == 0:
        return s, tangent
    first = KroghInterpolator(s[:3], tangent[:3])(0.0)
    return np.concatenate([[0.0], s]), np.concatenate([[unit(first)], tangent])


def hermite_curve(s: Float64, tangent: Float64) -> CubicHermiteSpline:
    """The hermite method's curve through one ribbon's nodes, from the origin at s = 0."""
    knot_s, knot_tangent = knots(s, tangent)
    chords = [
        segment_chord(t0, t1, h)
        for t0, t1, h in zip(knot_tangent[:-1], knot_tangent[1:], np.diff(knot_s), strict=True)
    ]
    return CubicHermiteSpline(
        knot_s, np.concatenate([np.zeros((1, 3)), np.cumsum(chords, axis=0)]), knot_tangent
    )


def spline_points(s: Float64, tangent: Float64, at: Float64) -> Float64:
    """Points (m, 3) of the default method's curve: eight Gauss points to a piece of the normalised spline."""
    spline = CubicSpline(s, tangent)
    x, w = np.polynomial.legendre.leggauss(8)

    def way(begin: float, end: float) -> Float64:
        return np.asarray((end - begin) / 2 * (w @ unit(spline(begin + (end - begin) / 2 * (x + 1)))))

    points = []
    for end in at:
        whole = [b for b in np.concatenate([[0.0], s]) if b <= end]
        breaks = np.unique([*whole, end])
        points.append(sum((way(b, e) for b, e in pairwise(breaks)), np.zeros(3)))
    return np.array(points)


def slerp(a: Float64, b: Float64, u: float) -> Float64:
    """Point at u of the great circle through unit vectors a (0) and b (1)."""
    angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    if angle == 0:
        return a
    return np.asarray((np.sin((1 - u) * angle) * a + np.sin(u * angle) * b) / np.sin(angle))


def spherical_bezier(s: Float64, control: Float64, tangent: Float64) -> Float64:
    """Bezier points (n - 1, 4, 3) of a cubic spline on the sphere from its control polygon (n, 3)."""
    h = np.concatenate([[0.0], np.diff(s), [0.0]])
    pieces = []
    for k in range(len(s) - 1):
        before, own, after = h[k : k + 3]
        inner = [
            slerp(control[k], control[k + 1], part / (before + own + after))
            for part in (before, before + own)
        ]
        pieces.append([tangent[k], *inner, tangent[k + 1]])
    return np.array(pieces)


def spherical_control(s: Float64, tangent: Float64) -> Float64:
    """Control polygon (n, 3) of the cubic spline on the sphere through the tangents, by relaxation.

    At inner nodes the point between the neighbouring inner Bezier points must be the tangent; at the ends
    the first inner point lies half way between the tangent and the second.
    """
    control = tangent.copy()
    for _ in range(150):
        bezier = spherical_bezier(s, control, tangent)
        control[0] = slerp(tangent[0], bezier[0, 2], 0.5)
        control[-1] = slerp(tangent[-1], bezier[-1, 1], 0.5)
        for k in range(1, len(s) - 1):
            made = slerp(bezier[k - 1, 2], bezier[k, 1], (s[k] - s[k - 1]) / (s[k + 1] - s[k - 1]))
            control[k] = unit(control[k] + tangent[k] - made)
    return control


def spherical_points(s: Float64, tangent: Float64, at: Float64) -> Float64:
    """Points (m, 3) of the paper's start: De Casteljau with slerp, eight Gauss points to a piece."""
    bezier = spherical_bezier(s, spherical_control(s, tangent), tangent)
    x, w = np.polynomial.legendre.leggauss(8)

    def direction(x_s: float) -> Float64:
        k = int(np.clip(np.searchsorted(s, x_s, side="right") - 1, 0, len(s) - 2))
        level = list(bezier[k])
        while len(level) > 1:
            u = (x_s - s[k]) / (s[k + 1] - s[k])
            level = [slerp(a, b, u) for a, b in pairwise(level)]
        return np.asarray(level[0])

    points = []
    for end in at:
        breaks = np.unique([*(b for b in np.concatenate([[0.0], s]) if b <= end), end])
        point = np.zeros(3)
        for b, e in pairwise(breaks):
            gauss = np.stack([direction(b + (e - b) / 2 * (xi + 1)) for xi in x])
            point = point + (e - b) / 2 * (w @ gauss)
        points.append(point)
    return np.array(points)


def bending(s: Float64, tangent: Float64, at: Float64) -> tuple[Float64, Float64]:
    """Curvature and torsion (m,) of the default curve, from differences of its tangent."""
    spline, step = CubicSpline(s, tangent), 1e-4
    before, here, after = (unit(spline(at + shift)) for shift in (-step, 0, step))
    first, second = (after - before) / (2 * step), (after - 2 * here + before) / step**2
    curvature = np.linalg.norm(first, axis=1)
    return curvature, np.einsum("id,id->i", np.cross(here, first), second) / curvature**2


def smooth(t: Float64, q: Float64, tau: float) -> Float64:
    """(frames, 4) orientations of one node, of equal signs, after two low-passes of time constant tau."""
    out = q
    for _ in range(2):
        values, given = [out[0]], out
        for k in range(1, len(t)):

            def rate(at: float, y: Float64, k: int = k, given: Float64 = given) -> Float64:
                share = (at - t[k - 1]) / (t[k] - t[k - 1])
                return np.asarray(((1 - share) * given[k - 1] + share * given[k] - y) / tau)

            solution = solve_ivp(rate, (t[k - 1], t[k]), values[-1], rtol=1e-12, atol=1e-14)
            values.append(solution.y[:, -1])
        out = np.array(values)
    return unit(out)


def transversal_row(start: Float64, position: Float64, direction: Float64) -> tuple[Float64, int]:
    """lambda (R,) of one row of points and unit directions (R, 3), and how many were held at the minimum.

    Bending energy by quadrature: it is quadratic in lambda, exactly integrated by two Gauss points a segment.
    """
    ribbons = len(start)
    x, w = np.polynomial.legendre.leggauss(2)

    def second(lambda_: Float64, p: Float64) -> Float64:
        curve = CubicHermiteSpline(start, p, lambda_[:, None] * direction).derivative(2)
        at = start[:-1, None] + np.diff(start)[:, None] * (x + 1) / 2
        weight = np.sqrt(np.diff(start)[:, None] * w / 2)
        return np.asarray((weight[..., None] * curve(at)).ravel())

    constant = second(np.zeros(ribbons), position)
    columns = np.stack([second(e, np.zeros_like(position)) for e in np.eye(ribbons)], axis=1)
    free, lambda_ = np.ones(ribbons, bool), np.full(ribbons, LAMBDA_MIN)
    while True:
        held_part = columns[:, ~free].sum(axis=1) * LAMBDA_MIN
        lambda_[free] = np.linalg.lstsq(columns[:, free], -constant - held_part, rcond=None)[0]
        small = free & (lambda_ < LAMBDA_MIN)
        if not small.any():
            return lambda_, int((~free).sum())
        free &= ~small
        lambda_[~free] = LAMBDA_MIN


def patch(
    ds: float,
    dt: float,
    position: Float64,
    along: Float64,
    across: Float64,
    side: int,
    twist: Float64 | None = None,
) -> tuple[Float64, Float64]:
    """Vertices and normals (side, side, 3) of a patch; corner arrays (2, 2, 3), first index along the ribbon.

    Partially bicubically blended Coons: cubic borders, blended by the cubic Hermite functions of 0 and
    1, minus the corners that were counted twice (Coons 1974); a twist adds its own bicubic term.
    Derivatives are of polynomials.
    """
    u = np.linspace(0, 1, side)
    blend = CubicHermiteSpline([0, 1], np.eye(2), np.zeros((2, 2)))
    slopes = CubicHermiteSpline([0, 1], np.zeros((2, 2)), np.eye(2))
    borders_along = CubicHermiteSpline([0, 1], position, ds * along)  # at ribbons 0 and 1: (2, 3)
    borders_across = CubicHermiteSpline([0, 1], position.swapaxes(0, 1), dt * across.swapaxes(0, 1))
    twist = np.zeros((2, 2, 3)) if twist is None else ds * dt * twist

    def surface(du: int, dv: int) -> Float64:
        ruled = np.einsum("ubd,vb->uvd", borders_along(u, du), blend(u, dv))
        ruled += np.einsum("ua,vad->uvd", blend(u, du), borders_across(u, dv))
        ruled -= np.einsum("ua,abd,vb->uvd", blend(u, du), position, blend(u, dv))
        return np.asarray(ruled + np.einsum("ua,abd,vb->uvd", slopes(u, du), twist, slopes(u, dv)))

    return surface(0, 0), unit(np.cross(surface(1, 0), surface(0, 1)))


def comb_frame(
    s: Float64, start: Float64, q: Float64, side: int, method: str = "spline", measured_twist: bool = True
) -> dict[str, Float64]:
    """The fields of a CombFrame of the same names, all nodes valid: q (R + 1, n, 4)."""
    axes = rotation(q)
    tangent, binormal = axes[..., 0], axes[1:, :, :, 1]
    if method == "hermite":
        curves = [hermite_curve(s, t) for t in tangent]
        anchor, shape = curves[0](start), np.stack([curve(s) for curve in curves])
    else:
        anchor = spline_points(s, tangent[0], start)
        shape = np.stack([spline_points(s, t, s) for t in tangent])
    anchor = np.concatenate([np.zeros((1, 3)), anchor])
    node = anchor[:, None] + shape
    ribbon = node[1:]
    lead = np.sign(np.einsum("jkd,jkd->j", np.gradient(ribbon, axis=0), binormal))
    direction = binormal * lead[:, None, None]
    rows = [transversal_row(start, ribbon[:, k], direction[:, k]) for k in range(len(s))]
    lambda_ = np.stack([row[0] for row in rows], axis=1)
    across = lambda_[..., None] * direction
    twist = CubicSpline(s, across, axis=1)(s, 1) if measured_twist else np.zeros_like(across)
    vertices = np.empty((len(start) - 1, len(s) - 1, side, side, 3))
    normals = np.empty_like(vertices)
    for j in range(len(start) - 1):
        for k in range(len(s) - 1):
            corners = (a[j : j + 2, k : k + 2].swapaxes(0, 1) for a in (ribbon, tangent[1:], across, twist))
            position, along, transversal, mixed = corners
            vertices[j, k], normals[j, k] = patch(
                s[k + 1] - s[k], start[j + 1] - start[j], position, along, transversal, side, mixed
            )
    return {
        "anchor_m": anchor,
        "node_m": node,
        "tangent": tangent,
        "along": tangent[1:],
        "transversal": across,
        "lambda_": lambda_,
        "twist": twist,
        "vertices_m": vertices,
        "normals": normals * lead[0],
        "lambda_limited": np.array(sum(row[1] for row in rows)),
    }
