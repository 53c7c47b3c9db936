"""A whole comb frame against the reference, and what happens to it when nodes or ribbons are missing."""

from dataclasses import fields

import numpy as np
import pytest
from reconstruct import combs
from reconstruct.combs import LAYOUT
from ribbonhost.bench.speed import orientations
from ribbonhost.reconstruct import (
    CombFrame,
    CombLayout,
    CombSolver,
    error_percent,
    patch_points,
    reference,
    seam_angles_deg,
)

ALL = np.ones((6, 16), bool)


def assert_same(frame: CombFrame, expected: dict[str, np.ndarray]) -> None:
    for name in ("anchor_m", "node_m", "tangent", "along"):
        np.testing.assert_allclose(getattr(frame, name), expected[name], atol=1e-12, err_msg=name)
    for name in ("transversal", "lambda_", "twist"):
        np.testing.assert_allclose(getattr(frame, name), expected[name], atol=1e-8, err_msg=name)
    np.testing.assert_allclose(frame.vertices_m, expected["vertices_m"], atol=3e-7)
    # Single precision; where the surface folds over, its normal is the direction of a small difference.
    np.testing.assert_allclose(frame.normals, expected["normals"], atol=2e-4)
    assert frame.lambda_limited == expected["lambda_limited"]


@pytest.mark.parametrize("twist", ["measured", "zero"])
@pytest.mark.parametrize("method", ["spline", "hermite"])
@pytest.mark.parametrize("scene", ["sea", "wing"])
def test_frame_on_a_scene_agrees_with_reference(scene: str, method: str, twist: str, true_comb) -> None:
    q = true_comb(scene).q_world_node[3]
    expected = reference.comb_frame(
        LAYOUT.node_s_m, np.array(LAYOUT.start_m), q, 4, method, twist == "measured"
    )
    assert_same(CombSolver(LAYOUT, method, patch_vertices=4, twist=twist).solve(q), expected)


@pytest.mark.parametrize("method", ["spline", "hermite"])
def test_frame_of_an_uneven_crossing_comb_agrees_with_reference(method: str) -> None:
    """Ribbons that lie across each other, where lambda has to be held."""
    rng = np.random.default_rng(21)
    layout = CombLayout(0.02, 7, (0.013, 0.05, 0.2, 0.26))
    q = np.stack([combs.random_ribbon(rng, 7, 0.5) for _ in range(5)])
    expected = reference.comb_frame(layout.node_s_m, np.array(layout.start_m), q, 3, method)
    assert expected["lambda_limited"] > 0
    frame = CombSolver(layout, method, patch_vertices=3).solve(q)
    assert_same(frame, expected)
    assert frame.lambda_.min() > 0


def test_many_frames_are_each_as_one(true_comb) -> None:
    """Also with invalid nodes and a missing ribbon; patches only when asked for."""
    q = true_comb("breath").q_world_node
    valid = np.ones(q.shape[:-1], bool)
    valid[2, 3, 4:6] = False
    valid[5, 2] = False
    solver = CombSolver(LAYOUT, patch_vertices=3)
    many = solver.solve_many(q, valid, patches=True)
    assert len(many) == len(q)
    for f in (0, 2, 5):
        one = solver.solve(q[f], valid[f])
        for field in fields(CombFrame):
            np.testing.assert_array_equal(getattr(many, field.name)[f], getattr(one, field.name), field.name)
    assert len(solver.solve_many(q[:0])) == 0
    without = solver.solve_many(q, valid)
    assert without.vertices_m.shape[0] == 0
    np.testing.assert_array_equal(without.node_m, many.node_m)


@pytest.mark.parametrize(
    ("method", "scene", "limit_percent"),
    [
        ("hermite", "sea", 0.3),
        ("hermite", "wing", 0.03),
        ("hermite", "breath", 0.06),
        ("spline", "sea", 0.03),
        ("spline", "wing", 0.0005),
        ("spline", "breath", 0.002),
    ],
)
def test_whole_comb_is_near_the_truth(method: str, scene: str, limit_percent: float, true_comb) -> None:
    """Exact orientations at the places of the magnetometers, reference measured too."""
    truth = true_comb(scene)
    solved = CombSolver(LAYOUT, method).solve_many(truth.q_world_node).node_m
    assert error_percent(solved[:, 1:], truth.node_m[:, 1:], LAYOUT.length_m) < limit_percent


def test_seams_have_no_angle(true_comb) -> None:
    """1e-6 degrees, with either twist, with a ribbon missing, and with ribbons that cross."""
    valid = ALL.copy()
    valid[2] = False
    for scene in ("wing", "sea"):
        q = true_comb(scene).q_world_node[1]
        for twist in ("measured", "zero"):
            for present in (ALL, valid):
                frame = CombSolver(LAYOUT, twist=twist).solve(q, present)
                angles = seam_angles_deg(LAYOUT, frame)
                assert len(angles) > 500
                assert angles.max() < 1e-6


def test_patch_points_are_the_vertices(true_comb) -> None:
    """Also where a missing ribbon is spanned: 3e-7 m."""
    valid = ALL.copy()
    valid[3] = False
    for present in (ALL, valid):
        frame = CombSolver(LAYOUT, patch_vertices=5).solve(true_comb("breath").q_world_node[3], present)
        u = np.linspace(0, 1, 5)
        np.testing.assert_allclose(patch_points(LAYOUT, frame, u, u), frame.vertices_m, atol=3e-7)


def test_normals_point_out_of_the_surface(true_comb) -> None:
    normals = CombSolver(LAYOUT).solve(true_comb("wing").q_world_node[0], ALL).normals
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-6)
    assert normals[..., 2].min() > 0


def test_invalid_nodes_are_bridged(true_comb) -> None:
    """Three nodes missing on one ribbon: within 1 mm there, all other ribbons exactly as before."""
    q = true_comb("wing").q_world_node[1].copy()
    solver = CombSolver(LAYOUT)
    whole = solver.solve(q, ALL)
    valid = ALL.copy()
    valid[2, [0, 7, 15]] = False
    q[~valid] = np.nan
    frame = solver.solve(q, valid)
    moved = np.linalg.norm(frame.node_m - whole.node_m, axis=-1)
    assert 0 < moved[2].max() < 1e-3
    assert np.delete(moved, 2, axis=0).max() == 0
    assert np.array_equal(frame.bridged, ~valid)
    assert frame.ribbon_valid.all()


def test_missing_ribbon_leaves_the_surface_between_its_neighbours(true_comb) -> None:
    q = true_comb("breath").q_world_node[1].copy()
    valid = ALL.copy()
    valid[3] = False
    q[3] = np.nan
    frame = CombSolver(LAYOUT, patch_vertices=5).solve(q, valid)
    assert frame.ribbon_valid.tolist() == [True, True, True, False, True, True]
    wide_layout = CombLayout(0.025, 16, (0.0, 0.15, 0.45, 0.60))
    wide = CombSolver(wide_layout, patch_vertices=9).solve(np.delete(q, 3, axis=0), np.delete(ALL, 3, axis=0))
    together = np.concatenate([frame.vertices_m[1, :, ::1], frame.vertices_m[2, :, :, 1:]], axis=2)
    np.testing.assert_allclose(together, wide.vertices_m[1, :, ::2], atol=2e-7)
    np.testing.assert_allclose(frame.vertices_m[0], wide.vertices_m[0, :, ::2, ::2], atol=2e-7)


def test_missing_end_ribbon_does_not_stop_the_others(true_comb) -> None:
    q = true_comb("wing").q_world_node[2]
    valid = ALL.copy()
    valid[5] = False
    frame = CombSolver(LAYOUT).solve(q, valid)
    assert np.isnan(frame.vertices_m[3]).all()
    assert np.isfinite(frame.vertices_m[:3]).all()
    assert np.isfinite(frame.node_m[:5]).all()


def test_missing_reference_leaves_the_ribbons_shapes(true_comb) -> None:
    q = true_comb("wing").q_world_node[2]
    valid = ALL.copy()
    valid[0] = False
    frame = CombSolver(LAYOUT).solve(q, valid)
    whole = CombSolver(LAYOUT).solve(q, ALL)
    assert not frame.ribbon_valid[0]
    np.testing.assert_allclose(frame.anchor_m[1:, 0], LAYOUT.start_m, atol=0)
    shape, whole_shape = (f.node_m[1:] - f.anchor_m[1:, None] for f in (frame, whole))
    np.testing.assert_allclose(shape, whole_shape, atol=1e-12)
    assert np.isfinite(frame.vertices_m).all()


@pytest.mark.parametrize("present", [0, 1])
def test_comb_without_two_ribbons_has_no_surface(present: int, true_comb) -> None:
    valid = np.zeros((6, 16), bool)
    valid[: 1 + present] = True
    frame = CombSolver(LAYOUT).solve(true_comb("sea").q_world_node[0], valid)
    assert np.isnan(frame.vertices_m).all()
    assert np.isfinite(frame.node_m[: 1 + present]).all()


def test_solver_names_bad_arguments() -> None:
    solver = CombSolver(LAYOUT)
    q = np.zeros((6, 16, 4))
    q[..., 0] = 1
    for bad, error, word in [
        (q[:5], ValueError, "q_world_node"),
        (q.astype(np.float32), TypeError, "q_world_node"),
        (q.tolist(), TypeError, "q_world_node"),
        (np.asfortranarray(q), ValueError, "contiguous"),
        (q * np.nan, ValueError, "q_world_node holds NaN"),
        (q * 1.1, ValueError, "q_world_node .*unit"),
        (q * 0, ValueError, "q_world_node .*unit"),
    ]:
        with pytest.raises(error, match=word):
            solver.solve(bad, ALL)
    for bad_valid, error in [(ALL[:, :5], ValueError), (ALL.astype(np.uint8), TypeError)]:
        with pytest.raises(error, match="valid"):
            solver.solve(q, bad_valid)


@pytest.mark.parametrize(
    ("pitch_m", "node_count", "start_m", "word"),
    [
        (0.0, 16, (0.0, 0.1), "pitch_m"),
        (float("nan"), 16, (0.0, 0.1), "pitch_m"),
        (0.025, 1, (0.0, 0.01), "node_count"),
        (0.025, 16, (0.0,), "start_m"),
        (0.025, 16, (0.1, 0.1), "start_m"),
        (0.025, 16, (-0.1, 0.1), "start_m"),
        (0.025, 16, (0.0, 0.776), "start_m"),
        (0.025, 16, (0.0, float("nan")), "start_m"),
    ],
)
def test_layout_names_bad_arguments(
    pitch_m: float, node_count: int, start_m: tuple[float, ...], word: str
) -> None:
    with pytest.raises(ValueError, match=word):
        CombLayout(pitch_m, node_count, start_m)


def test_solver_names_unknown_method_and_patch_size() -> None:
    with pytest.raises(ValueError, match="method"):
        CombSolver(LAYOUT, method="guess")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="patch_vertices"):
        CombSolver(LAYOUT, patch_vertices=1)


def test_rounding_is_no_shape() -> None:
    """Ribbons bent in planes along y alone: what rounding leaves along x is no slope of the surface.

    Squares of slopes of 1e-17 and less would be denormal numbers, and slow.
    """
    frame = CombSolver(LAYOUT).solve(orientations(1, 5, 16)[0])
    assert 0 < np.abs(frame.tangent[1:, :, 0]).max() < 1e-15
    for values in (frame.normals, frame.vertices_m):
        assert not ((values != 0) & (np.abs(values) < 1e-12)).any()
