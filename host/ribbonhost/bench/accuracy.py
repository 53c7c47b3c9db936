"""Error E of combs and surfaces against the truth, for each kind of data and each method."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ribbonhost.bench import chain
from ribbonhost.reconstruct import (
    CombLayout,
    CombSolver,
    LiveSmoother,
    RibbonSolver,
    curve_points,
    ribbon_covariance,
    seam_angles_deg,
)
from ribbonhost.reconstruct.comb import METHODS

if TYPE_CHECKING:
    from ribbonhil.geodesics import Geodesics
    from ribbonhil.scenes import Scene

Float64 = NDArray[np.float64]

LAYOUT = CombLayout(0.025, 16, (0.0, 0.15, 0.30, 0.45, 0.60))
SMOOTHING_HZ = 10.0
COVERAGE_RUNS = 500
COVERAGE_SIGMA_RAD = 0.01
CHI_SQUARE_95 = 7.814727903251179  # three degrees of freedom

DATA = {
    "exact": "orientations without error at the magnetometers, reference measured too",
    "noise_free": "emulated sensors, firmware and packets; each frame held still, no noise",
    "noise": "the parts' noise, frame by frame at 100 Hz; the surface moves, its acceleration is left out",
    "noise_smoothed": f"the same through {SMOOTHING_HZ:g} Hz smoothing, against the truth before its delay",
    "noise_at_rest": "the parts' noise, each frame held still, which the firmware uses to average it away",
    "motion": "the parts' noise, and the acceleration of the scene's own period, which is taken for a tilt",
    "motion_smoothed": f"the same through {SMOOTHING_HZ:g} Hz smoothing, against the truth before its delay",
    "paper": "exact tangents at 16 nodes from the anchor on, four ribbons, reference known where they start",
}
"""The kinds of data that E is measured for. All but `motion` and `motion_smoothed` are about sensors and
reconstruction. What acceleration does to a reading is a thing of its own, and the motion estimator's to mend:
`ribbonhost bench motion`."""


@dataclass(frozen=True)
class Errors:
    """E of frames, percent."""

    percent: Float64

    def summary(self) -> dict[str, float]:
        known = self.percent[np.isfinite(self.percent)]
        return {"mean": float(known.mean()), "min": float(known.min()), "max": float(known.max())}


def comb_errors(layout: CombLayout, node_m: Float64, truth_m: Float64) -> Errors:
    """E of each frame, (frames, R + 1, n, 3) against the truth; the reference does not count."""
    distance = np.linalg.norm(node_m[:, 1:] - truth_m[:, 1:], axis=-1)
    return Errors(100 * distance.mean(axis=(1, 2)) / layout.length_m)


def solve(data: chain.Orientations, method: str) -> Errors:
    """E of combs reconstructed from orientations."""
    solver = CombSolver(LAYOUT, method)  # type: ignore[arg-type]
    solved = solver.solve_many(data.q_world_node, data.valid)
    return comb_errors(LAYOUT, solved.node_m, data.node_m)


def pick(data: chain.Orientations, frames: int) -> chain.Orientations:
    """`frames` frames at equal steps."""
    at = np.linspace(0, len(data.t_s), frames, endpoint=False).astype(int)
    return chain.Orientations(
        data.t_s[at], data.q_world_node[at], data.valid[at], data.sigma_rad[at], data.node_m[at]
    )


def smoothed(scene: "Scene", data: chain.Orientations) -> chain.Orientations:
    """What a live smoother makes of a stream, with the truth of the time that it is for."""
    from ribbonhil.truth import comb_truth

    smoother = LiveSmoother(SMOOTHING_HZ, data.valid.shape[1:])
    q = np.array(
        [smoother.smooth(*frame) for frame in zip(data.t_s, data.q_world_node, data.valid, strict=True)]
    )
    valid = data.valid & np.isfinite(q[..., 0])
    truth = comb_truth(scene, chain.RIBBONS)
    node_m = truth.node_from_anchor_m(data.t_s - smoother.delay_s)
    settled = data.t_s > data.t_s[0] + 10 * smoother.delay_s
    return chain.Orientations(
        data.t_s[settled], q[settled], valid[settled], data.sigma_rad[settled], node_m[settled]
    )


def paper_errors(lines: "Geodesics", method: str) -> Errors:
    """E on the paper's kind of data: its reference ribbon is measured at the four starting points alone."""
    start_m, node_s_m = np.array([0.0, 0.15, 0.30, 0.45]), 0.05 * np.arange(16)
    starts = np.rint(start_m / LAYOUT.pitch_m).astype(int)
    tangent = np.ascontiguousarray(lines.tangent[:, 1 : 1 + len(starts), 0:31:2])
    truth_m = lines.position_m[:, 1 : 1 + len(starts), 0:31:2] - lines.position_m[:, :1, :1]
    reference = curve_points(start_m, np.ascontiguousarray(lines.tangent[:, 0, starts]), method=method)  # type: ignore[arg-type]
    ribbons = curve_points(node_s_m, tangent, method=method)  # type: ignore[arg-type]
    distance = np.linalg.norm(ribbons + reference[:, :, None] - truth_m, axis=-1)
    return Errors(100 * distance.mean(axis=(1, 2)) / node_s_m[-1])


def surface_figures(scene: "Scene", data: chain.Orientations, anchor_m: Float64) -> dict[str, Any]:
    """Distance of the vertices from the true surface by twist, angles at seams, and held lambda.

    anchor_m: (frames, 3) where the origin truly is. The distance is along the true normal, to first order.
    """
    figures: dict[str, Any] = {}
    for twist in ("zero", "measured"):
        solver = CombSolver(LAYOUT, twist=twist)
        frames = [solver.solve(q, v) for q, v in zip(data.q_world_node, data.valid, strict=True)]
        vertices = np.array([frame.vertices_m for frame in frames], np.float64)
        distance = _distance(scene, vertices + anchor_m[:, None, None, None, None], data.t_s / scene.period_s)
        figures[twist] = {
            "mean_mm": 1e3 * float(distance.mean()),
            "max_mm": 1e3 * float(distance.max()),
            "seam_deg": max(float(seam_angles_deg(LAYOUT, frame).max()) for frame in frames[::10]),
            "lambda_min": min(float(frame.lambda_.min()) for frame in frames),
            "lambda_held": sum(frame.lambda_limited for frame in frames),
            "lambda_count": sum(frame.lambda_.size for frame in frames),
        }
    return figures


def _distance(scene: "Scene", points: Float64, t: Float64) -> Float64:
    """(...) distance of points (frames, ..., 3) from the surface at periods t (frames,)."""
    from ribbonhil.scenes import derivatives

    x, y, z = np.moveaxis(points, -1, 0)
    every_t = np.broadcast_to(t.reshape(-1, *(1,) * (x.ndim - 1)), x.shape)
    ahead, left, _ = derivatives(scene, x, y, every_t, np.ones_like(x), np.zeros_like(x))
    return np.asarray(np.abs(z - scene.height(x, y, every_t)) / np.sqrt(1 + ahead**2 + left**2))


def coverage(q: Float64, truth_m: Float64, seed: int) -> dict[str, float]:
    """How often the nodes of a ribbon truly lie inside the 95 % region, over COVERAGE_RUNS draws of turns.

    q: (n, 4) true orientations. truth_m: (n, 3) true positions from the ribbon's own anchor.
    """
    rng = np.random.default_rng(seed)
    shape = (COVERAGE_RUNS, LAYOUT.node_count)
    measured = turned(q, COVERAGE_SIGMA_RAD * rng.normal(size=(*shape, 3)))
    error = RibbonSolver(LAYOUT.pitch_m, LAYOUT.node_count).solve(measured) - truth_m
    covariance = ribbon_covariance(LAYOUT.node_s_m, measured, np.full(shape, COVERAGE_SIGMA_RAD))
    inside = np.einsum("...i,...ij,...j->...", error, np.linalg.inv(covariance), error) < CHI_SQUARE_95
    return {"sigma_rad": COVERAGE_SIGMA_RAD, "runs": COVERAGE_RUNS, "percent": 100 * float(inside.mean())}


def straight_coverage(seed: int) -> dict[str, float]:
    """The same of a straight ribbon, along which errors are of second order only."""
    ahead = np.outer(LAYOUT.node_s_m, [1.0, 0.0, 0.0])
    return coverage(np.tile([1.0, 0.0, 0.0, 0.0], (LAYOUT.node_count, 1)), ahead, seed)


def turned(q: Float64, turns: Float64) -> Float64:
    """Orientations (..., 4), scalar first, turned by rotation vectors (..., 3) in world axes."""
    angle = np.linalg.norm(turns, axis=-1, keepdims=True)
    half = np.concatenate([np.cos(angle / 2), np.sinc(angle / (2 * np.pi)) / 2 * turns], axis=-1)
    aw, ax, ay, az = np.moveaxis(half, -1, 0)
    bw, bx, by, bz = np.moveaxis(q, -1, 0)
    product = [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
    return np.stack(product, axis=-1)


def measure_scene(name: str, frames: int, seed: int) -> dict[str, Any]:
    """All figures of one scene."""
    scene = chain.load(name)
    lines = chain.trace(scene, frames)
    exact = chain.exact(scene, lines)
    slow, swift = (chain.moving(scene, 1.0, seed, accelerated) for accelerated in (False, True))
    data = {
        "exact": exact,
        "noise_free": chain.at_rest(lines, 0.0, seed),
        "noise": pick(slow, frames),
        "noise_smoothed": pick(smoothed(scene, slow), frames),
        "noise_at_rest": chain.at_rest(lines, 1.0, seed),
        "motion": pick(swift, frames),
        "motion_smoothed": pick(smoothed(scene, swift), frames),
    }
    errors = {
        kind: {method: solve(orientations, method).summary() for method in METHODS}
        for kind, orientations in data.items()
    }
    errors["paper"] = {method: paper_errors(lines, method).summary() for method in METHODS}
    frame, ribbon = frames // 3, 2
    from_anchor_m = lines.position_m[frame, ribbon, 1::2] - lines.position_m[frame, ribbon, 0]
    return {
        "period_s": scene.period_s,
        "error_percent": errors,
        "invalid_nodes": {kind: int((~orientations.valid).sum()) for kind, orientations in data.items()},
        "surface": surface_figures(scene, exact, lines.position_m[:, 0, 0]),
        "coverage": coverage(exact.q_world_node[frame, ribbon], from_anchor_m, seed),
        "fastest_node_mps": _fastest_mps(swift),
    }


def _fastest_mps(stream: chain.Orientations) -> float:
    """Largest speed of a node of a moving comb."""
    way = np.linalg.norm(np.diff(stream.node_m, axis=0), axis=-1)
    return float((way / np.diff(stream.t_s)[:, None, None]).max())


def measure_accuracy(scenes: tuple[str, ...], frames: int, seed: int) -> dict[str, Any]:
    """E (mean, min, max over the frames, percent) by scene, data and method, and what else is measured."""
    return {
        "frames": frames,
        "seed": seed,
        "length_m": LAYOUT.length_m,
        "ribbons": chain.RIBBONS,
        "data": DATA,
        "coverage_straight": straight_coverage(seed),
        "scenes": {name: measure_scene(name, frames, seed) for name in scenes},
    }
