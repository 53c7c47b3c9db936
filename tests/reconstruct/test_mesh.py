"""Meshes of crossing ribbons on a surface that can be unrolled, where ribbons do cross at sensors."""

from dataclasses import dataclass

import numpy as np
import pytest
from reconstruct.combs import Array
from ribbonhost.reconstruct import MeshLayout, MeshSolver, RibbonSolver, node_arc_lengths
from scipy.spatial.transform import Rotation

SPACING_M, OBLIQUE_RAD = 0.1, 0.4
S = node_arc_lengths(0.025, 16)
LAYOUT = MeshLayout(
    tuple(S), tuple(S), warp_crossing=tuple(range(1, 15, 2)), weft_crossing=tuple(range(2, 14, 2))
)
WARPS, WEFTS = len(LAYOUT.weft_crossing), len(LAYOUT.warp_crossing)


@dataclass(frozen=True)
class TrueMesh:
    q_warp: Array
    q_weft: Array
    warp_m: Array
    weft_m: Array
    crossing_m: Array


def rolled(a: Array, b: Array) -> Array:
    """Points of the surface z(x) whose slope angle is slope(a) after the way a, b metres along y."""
    x, w = np.polynomial.legendre.leggauss(40)
    angle = slope(a[..., None] / 2 * (x + 1))
    return np.stack([np.cos(angle) @ w * a / 2, b, np.sin(angle) @ w * a / 2], axis=-1)


def slope(a: Array) -> Array:
    return 0.9 * np.sin(2 * np.pi * a / 0.9) + 0.5 * a


def orientations(a: Array, direction_rad: float) -> Array:
    """Of a straight line of the unrolled surface in that direction."""
    up, zero = slope(a), np.zeros_like(a)
    ahead, left = np.stack([np.cos(up), zero, np.sin(up)], -1), np.stack([zero, zero + 1, zero], -1)
    normal = np.cross(ahead, left)
    tangent = np.cos(direction_rad) * ahead + np.sin(direction_rad) * left
    frame = np.stack([tangent, np.cross(normal, tangent), normal], axis=-1)
    q = Rotation.from_matrix(frame.reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]]
    return np.ascontiguousarray(q.reshape(*a.shape, 4))


@pytest.fixture(scope="module")
def truth() -> TrueMesh:
    cos, sin = np.cos(OBLIQUE_RAD), np.sin(OBLIQUE_RAD)
    along = S - S[LAYOUT.warp_crossing[0]]
    across = S - S[LAYOUT.weft_crossing[0]]
    warp_at, weft_at = SPACING_M * np.arange(WARPS)[:, None], SPACING_M * np.arange(WEFTS)[:, None]
    warp = along * cos - warp_at * sin, along * sin + warp_at * cos
    weft = weft_at * cos - across * sin, weft_at * sin + across * cos
    warp_m, weft_m = rolled(*warp), rolled(*weft)
    crossing = warp_m[:, list(LAYOUT.warp_crossing)]
    origin = crossing[0, 0]
    return TrueMesh(
        orientations(warp[0], OBLIQUE_RAD),
        orientations(weft[0], OBLIQUE_RAD + np.pi / 2),
        warp_m - origin,
        weft_m - origin,
        crossing - origin,
    )


def test_exact_mesh_is_the_surface(truth: TrueMesh) -> None:
    """Every crossing and node within 20 um, closed within 2 um, normals up."""
    frame = MeshSolver(LAYOUT).solve(truth.q_warp, truth.q_weft)
    np.testing.assert_allclose(frame.crossing_m, truth.crossing_m, atol=2e-5)
    np.testing.assert_allclose(frame.warp_m, truth.warp_m, atol=2e-5)
    np.testing.assert_allclose(frame.weft_m, truth.weft_m, atol=2e-5)
    assert frame.misfit_m < 2e-6
    assert frame.normals[..., 2].min() > 0
    np.testing.assert_allclose(frame.vertices_m[:, :, 0, 0], frame.crossing_m[:-1, :-1], atol=1e-7)


def test_crossings_solve_the_least_squares_problem(truth: TrueMesh) -> None:
    """Against numpy.linalg.lstsq on the ways as they are measured: 1e-12 m."""
    rng = np.random.default_rng(71)
    q_warp, q_weft = noisy(rng, truth.q_warp), noisy(rng, truth.q_weft)
    frame = MeshSolver(LAYOUT).solve(q_warp, q_weft)
    solver = RibbonSolver(0.025, 16)
    warp, weft = (
        solver.solve(q_warp)[:, list(LAYOUT.warp_crossing)],
        solver.solve(q_weft)[:, list(LAYOUT.weft_crossing)],
    )
    rows, right = [], []

    def way(a: tuple[int, int], b: tuple[int, int], step: Array) -> None:
        row = np.zeros((WARPS, WEFTS))
        row[b], row[a] = 1, -1
        rows.append(row.ravel())
        right.append(step)

    for i in range(WARPS):
        for j in range(WEFTS - 1):
            way((i, j), (i, j + 1), warp[i, j + 1] - warp[i, j])
    for j in range(WEFTS):
        for i in range(WARPS - 1):
            way((i, j), (i + 1, j), weft[j, i + 1] - weft[j, i])
    solution = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0].reshape(WARPS, WEFTS, 3)
    np.testing.assert_allclose(frame.crossing_m, solution - solution[0, 0], atol=1e-12)
    misfit = np.array(rows) @ solution.reshape(-1, 3) - np.array(right)
    assert frame.misfit_m == pytest.approx(np.sqrt(np.mean(np.sum(misfit**2, axis=1))), rel=1e-9)


def noisy(rng: np.random.Generator, q: Array) -> Array:
    turn = Rotation.from_rotvec(0.01 * rng.normal(size=(q.size // 4, 3)))
    out = (turn * Rotation.from_quat(q.reshape(-1, 4)[:, [1, 2, 3, 0]])).as_quat()[:, [3, 0, 1, 2]]
    return np.ascontiguousarray(out.reshape(q.shape))


def test_closing_the_mesh_averages_noise(truth: TrueMesh) -> None:
    """Mean error of the crossings at most 70 % of that along one warp and its wefts alone, 40 runs."""
    rng = np.random.default_rng(72)
    solver, closed, open_ = MeshSolver(LAYOUT), [], []
    for _ in range(40):
        q_warp, q_weft = noisy(rng, truth.q_warp), noisy(rng, truth.q_weft)
        first_only = np.zeros((WARPS, 16), bool)
        first_only[0] = True
        closed.append(solver.solve(q_warp, q_weft).crossing_m - truth.crossing_m)
        open_.append(solver.solve(q_warp, q_weft, first_only).crossing_m - truth.crossing_m)
    ratio = np.linalg.norm(closed, axis=-1).mean() / np.linalg.norm(open_, axis=-1).mean()
    assert ratio < 0.7


def test_missing_ribbons_leave_the_crossings_to_the_others(truth: TrueMesh) -> None:
    warp_valid, weft_valid = np.ones((WARPS, 16), bool), np.ones((WEFTS, 16), bool)
    warp_valid[2] = False
    weft_valid[5] = False
    warp_valid[4, 7:9] = False
    frame = MeshSolver(LAYOUT).solve(truth.q_warp, truth.q_weft, warp_valid, weft_valid)
    assert frame.warp_valid.tolist() == [True, True, False, True, True, True]
    missing = np.isnan(frame.crossing_m[..., 0])
    assert np.argwhere(missing).tolist() == [[2, 5]]
    np.testing.assert_allclose(frame.crossing_m[~missing], truth.crossing_m[~missing], atol=2e-3)
    there = np.isfinite(frame.vertices_m).all(axis=(2, 3, 4))
    assert there.sum() == there.size - 4
    assert frame.normals[there][..., 2].min() > 0


def test_missing_first_ribbons_move_the_origin(truth: TrueMesh) -> None:
    warp_valid, weft_valid = np.ones((WARPS, 16), bool), np.ones((WEFTS, 16), bool)
    warp_valid[0] = weft_valid[0] = False
    frame = MeshSolver(LAYOUT).solve(truth.q_warp, truth.q_weft, warp_valid, weft_valid)
    assert np.isnan(frame.crossing_m[0, 0]).all()
    np.testing.assert_allclose(frame.crossing_m[0, 1], 0, atol=0)
    np.testing.assert_allclose(
        frame.crossing_m[3, 3], truth.crossing_m[3, 3] - truth.crossing_m[0, 1], atol=2e-5
    )


def test_mesh_names_bad_arguments(truth: TrueMesh) -> None:
    solver = MeshSolver(LAYOUT)
    with pytest.raises(ValueError, match="q_warp"):
        solver.solve(truth.q_warp[1:], truth.q_weft)
    with pytest.raises(ValueError, match="q_weft"):
        solver.solve(truth.q_warp, truth.q_weft * np.nan)
    with pytest.raises(ValueError, match="warp_valid"):
        solver.solve(truth.q_warp, truth.q_weft, np.zeros((WARPS, 16), bool))
    with pytest.raises(TypeError, match="weft_valid"):
        solver.solve(truth.q_warp, truth.q_weft, None, np.ones((WEFTS, 16)))
    for crossing in ((1,), (1, 1), (3, 2), (-1, 2), (1, 16)):
        with pytest.raises(ValueError, match="warp_crossing"):
            MeshLayout(tuple(S), tuple(S), crossing, (1, 2))
    with pytest.raises(ValueError, match="weft_s_m"):
        MeshLayout(tuple(S), (0.1, 0.1), (1, 2), (0, 1))
    with pytest.raises(ValueError, match="method"):
        MeshSolver(LAYOUT, method="guess")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="patch_vertices"):
        MeshSolver(LAYOUT, patch_vertices=65)
