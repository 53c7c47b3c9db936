"""Ribbons on a surface are geodesics at unit speed, against an independent integration."""

import numpy as np
import pytest
from hil.test_scenes import exact
from ribbonhil.geodesics import trace
from ribbonhil.scenes import BUILTIN, Scene, SceneError
from ribbonhil.truth import PITCH_M, SLOT_COUNT, SPACING_SLOTS, trace_comb
from scipy.integrate import solve_ivp

PHASES = np.arange(8) / 8


def slopes(name: str, x: float, y: float, t: float) -> tuple[np.ndarray, ...]:
    return tuple(float(d) for d in exact(name, np.array(x), np.array(y), np.array(t)))


def integrated(name: str, t: float, start: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """(n, 3) positions of one geodesic by DOP853, derivatives by hand; toward: (3,), tangent."""

    def rates(_: float, state: np.ndarray) -> list[float]:
        x, y, vx, vy = state
        zx, zy, zxx, zxy, zyy = slopes(name, x, y, t)
        k = (zxx * vx * vx + 2 * zxy * vx * vy + zyy * vy * vy) / (1 + zx * zx + zy * zy)
        return [vx, vy, -zx * k, -zy * k]

    s = np.arange(SLOT_COUNT) * PITCH_M
    path = solve_ivp(
        rates, (0, s[-1]), [*start[:2], *toward[:2]], method="DOP853", rtol=3e-13, atol=1e-14, t_eval=s
    )
    x, y = path.y[:2]
    return np.stack([x, y, BUILTIN[name].height(x, y, np.full_like(x, t))], axis=1)


@pytest.mark.parametrize("name", list(BUILTIN))
def test_ribbons_agree_with_an_independent_integration_to_1e_8_m(name: str):
    comb = trace_comb(BUILTIN[name], 5, PHASES)
    for phase, ribbon in [(1, 0), (0, 1), (3, 3), (6, 5)]:
        start, toward = comb.position_m[phase, ribbon, 0], comb.tangent[phase, ribbon, 0]
        expected = integrated(name, PHASES[phase], start, toward)
        np.testing.assert_allclose(comb.position_m[phase, ribbon], expected, atol=1e-8)


@pytest.mark.parametrize("name", list(BUILTIN))
def test_reference_leaves_eastward_and_ribbons_orthogonally_from_its_slots(name: str):
    comb = trace_comb(BUILTIN[name], 5, PHASES)
    np.testing.assert_array_equal(comb.position_m[:, 0, 0, :2], 0)
    assert (comb.tangent[:, 0, 0, 0] > 0).all()
    sideways = np.cross([1.0, 0, 0], comb.normal[:, 0, 0])
    np.testing.assert_allclose(np.einsum("ij,ij->i", comb.tangent[:, 0, 0], sideways), 0, atol=1e-12)
    for ribbon in range(1, 6):
        root = SPACING_SLOTS * (ribbon - 1)
        np.testing.assert_allclose(comb.position_m[:, ribbon, 0], comb.position_m[:, 0, root], atol=1e-15)
        np.testing.assert_allclose(comb.tangent[:, ribbon, 0], comb.binormal[:, 0, root], atol=1e-12)


@pytest.mark.parametrize("name", list(BUILTIN))
def test_lines_have_unit_speed_no_geodesic_curvature_and_right_handed_frames(name: str):
    fine_m, count = 1e-3, 400
    t = PHASES[:, None] + 0.03
    line = trace(
        BUILTIN[name], t, np.full((8, 1, 2), 0.1), np.broadcast_to([0.6, 0.8, 0.0], (8, 1, 3)), fine_m, count
    )
    p = line.position_m
    # Central differences of 4th order: truncation below 1e-8 and 1e-5 with this step.
    velocity = (8 * (p[:, :, 3:-1] - p[:, :, 1:-3]) - (p[:, :, 4:] - p[:, :, :-4])) / (12 * fine_m)
    bend = (-p[:, :, 4:] + 16 * p[:, :, 3:-1] - 30 * p[:, :, 2:-2] + 16 * p[:, :, 1:-3] - p[:, :, :-4]) / (
        12 * fine_m**2
    )
    inner = slice(2, -2)
    np.testing.assert_allclose(np.linalg.norm(velocity, axis=-1), 1, atol=1e-7)
    np.testing.assert_allclose(velocity, line.tangent[:, :, inner], atol=1e-7)
    geodesic_curvature = np.einsum("...i,...i", bend, line.binormal[:, :, inner])
    np.testing.assert_allclose(geodesic_curvature, 0, atol=1e-5)  # 1/m
    assert np.abs(bend).max() > 0.1
    np.testing.assert_allclose(np.cross(line.tangent, line.binormal), line.normal, atol=1e-12)
    assert (line.normal[..., 2] > 0).all()


def test_surface_that_is_too_rough_is_refused():
    rough = Scene("corrugated", lambda x, y, t: 0.004 * np.sin(2 * np.pi * x / 0.008) + 0 * t)
    with pytest.raises(SceneError, match=r"the surface of corrugated is too rough for a ribbon near x = "):
        trace_comb(rough, 2, PHASES)


def test_height_that_fails_on_the_way_is_one_sentence():
    def height(x, y, t):
        if y.max() > 0.3:
            raise ValueError("no surface there")
        return 0 * x

    with pytest.raises(SceneError, match="height in edge failed on the way of a ribbon: no surface there"):
        trace_comb(Scene("edge", height), 2, PHASES)
