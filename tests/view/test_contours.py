"""A mesh is cut into bands that cover it once, turn its way, and keep to their levels."""

import numpy as np
import pytest
from numpy.typing import NDArray
from ribbonhost.export.animation import grid_triangles
from ribbonhost.view.contours import Cut, Cutter

U, W, BANDS = 31, 17, 8
THERE = np.ones(U * W, np.bool_)


def grid() -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Vertices (V, 3) of a flat grid of 1 m x 0.5 m, and levels from below 0 to above BANDS."""
    x, y = np.meshgrid(np.linspace(0, 1, U), np.linspace(0, 0.5, W), indexing="ij")
    levels = BANDS * (0.5 + 0.6 * np.sin(7 * x) * np.cos(9 * y))
    return np.stack([x, y, 0 * x], -1).reshape(-1, 3).astype(np.float32), levels.ravel()


def areas(cut: Cut, vertices: NDArray[np.float32]) -> list[NDArray[np.float64]]:
    """Signed areas of the triangles of each band, seen from above."""
    points = cut.points(vertices).astype(np.float64)
    found = []
    for at, faces in cut.bands:
        a, b, c = (points[at][faces[:, k]] for k in range(3))
        found.append(0.5 * np.cross(b - a, c - a)[:, 2])
    return found


def test_bands_cover_the_mesh_once_and_face_its_way() -> None:
    vertices, levels = grid()
    triangles = grid_triangles(U, W)
    way = np.sign(areas(Cutter(triangles).cut(np.full(U * W, np.nan), THERE, BANDS), vertices)[-1][0])
    found = areas(Cutter(triangles).cut(levels, THERE, BANDS), vertices)
    assert sum(float(band.sum()) for band in found) == pytest.approx(way * 0.5, abs=1e-6)
    assert min(float((way * band).min()) for band in found if len(band)) > -1e-9


def test_every_point_lies_between_the_levels_of_its_band() -> None:
    _, levels = grid()
    cut = Cutter(grid_triangles(U, W)).cut(levels, THERE, BANDS)
    at_points = cut.points(np.clip(levels, 0, BANDS)[:, None].astype(np.float32))[:, 0]
    for band, (at, faces) in enumerate(cut.bands[:BANDS]):
        assert len(faces)
        assert (at_points[at] >= band - 1e-4).all()
        assert (at_points[at] <= band + 1 + 1e-4).all()


def test_points_follow_the_vertices_without_a_new_cut() -> None:
    vertices, levels = grid()
    cut = Cutter(grid_triangles(U, W)).cut(levels, THERE, BANDS)
    moved = vertices @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], np.float32) + np.float32(3.0)
    before, after = areas(cut, vertices), areas(cut, moved)
    assert all(np.allclose(a, b, atol=1e-6) for a, b in zip(before, after, strict=True))


def test_what_has_no_value_is_a_band_of_its_own_and_what_is_not_there_a_hole() -> None:
    vertices, levels = grid()
    levels[: 10 * W] = np.nan
    there = THERE.copy()
    there[: 4 * W] = False
    *found, unknown = areas(Cutter(grid_triangles(U, W)).cut(levels, there, BANDS), vertices)
    assert abs(sum(float(band.sum()) for band in found)) == pytest.approx(0.5 * 20 / 30, abs=1e-6)
    assert abs(float(unknown.sum())) == pytest.approx(0.5 * 6 / 30, abs=1e-6)


def test_nothing_there_is_nothing() -> None:
    vertices, levels = grid()
    found = areas(Cutter(grid_triangles(U, W)).cut(levels, ~THERE, BANDS), vertices)
    assert [len(band) for band in found] == [0] * (BANDS + 1)


@pytest.mark.parametrize("levels", [np.zeros(U * W), np.full(U * W, BANDS + 5.0), np.full(U * W, 3.0)])
def test_one_value_everywhere_is_one_band(levels: NDArray[np.float64]) -> None:
    cut = Cutter(grid_triangles(U, W)).cut(levels, THERE, BANDS)
    assert [len(faces) > 0 for _, faces in cut.bands].count(True) == 1
