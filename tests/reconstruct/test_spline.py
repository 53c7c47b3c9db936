"""The default method: against its reference, its order, its exact length, its corner cases."""

from itertools import pairwise

import numpy as np
import pytest
from reconstruct import combs
from ribbonhost.reconstruct import curve_bending, curve_points, reference


def helix(s: np.ndarray, radius_m: float, pitch_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points, from the origin, and tangents (n, 3) at arc lengths s of a helix; pitch_m per radian."""
    speed = np.hypot(radius_m, pitch_m)
    angle = s / speed
    zero = np.zeros_like(s)
    points = np.stack(
        [radius_m * (np.cos(angle) - 1), radius_m * np.sin(angle), pitch_m * angle + zero], axis=1
    )
    tangent = np.stack([-radius_m * np.sin(angle), radius_m * np.cos(angle), pitch_m + zero], axis=1) / speed
    return points, tangent


@pytest.mark.parametrize("nodes", [2, 3, 4, 5, 16])
@pytest.mark.parametrize("first_s", [0.0, 0.02])
def test_spline_agrees_with_reference(nodes: int, first_s: float) -> None:
    """Random uneven nodes and turns, at the nodes and between: 1e-12 m."""
    rng = np.random.default_rng(nodes)
    s = first_s + np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.08, nodes - 1))])
    at = np.concatenate([s, [0.0, first_s / 2], rng.uniform(0, s[-1], 9)])
    for turn_rad in (0.05, 0.4, 1.0):
        tangent = reference.rotation(combs.random_ribbon(rng, nodes, turn_rad))[:, :, 0].copy()
        expected = reference.spline_points(s, tangent, at)
        np.testing.assert_allclose(curve_points(s, tangent, at), expected, atol=1e-12)
        np.testing.assert_allclose(curve_points(s, tangent), expected[:nodes], atol=1e-12)


@pytest.mark.parametrize("nodes", [2, 3, 4, 7, 16])
@pytest.mark.parametrize("first_s", [0.0, 0.02])
def test_spherical_start_agrees_with_reference(nodes: int, first_s: float) -> None:
    """The polygon by another iteration, De Casteljau by recursion: 1e-11 m."""
    rng = np.random.default_rng(40 + nodes)
    s = first_s + np.concatenate([[0.0], np.cumsum(rng.uniform(0.03, 0.06, nodes - 1))])
    at = np.concatenate([s, [0.0, first_s / 2], rng.uniform(0, s[-1], 5)])
    tangent = reference.rotation(combs.random_ribbon(rng, nodes, 0.3))[:, :, 0].copy()
    expected = reference.spherical_points(s, tangent, at)
    np.testing.assert_allclose(curve_points(s, tangent, at, method="spherical"), expected, atol=1e-11)
    np.testing.assert_allclose(curve_points(s, tangent, method="spherical"), expected[:nodes], atol=1e-11)


@pytest.mark.parametrize(("method", "order"), [("hermite", 2), ("spline", 4), ("spherical", 4)])
def test_order_on_a_wound_curve(method: str, order: int) -> None:
    """Halving the spacing divides the error at inner nodes by at least 2^(order - 0.2).

    A curve whose curvature and torsion change; the spherical start does not bend at its ends, so there the
    curve has to be straight for its order to show.
    """

    def tangent(s: np.ndarray) -> np.ndarray:
        bump = np.where((s > 0.05) & (s < 0.75), np.sin(np.pi * (s - 0.05) / 0.7) ** 6, 0.0)
        azimuth, elevation = 1.5 * bump * (1 + s), 0.8 * bump * np.cos(5 * s)
        return np.stack(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)],
            axis=-1,
        )

    x, w = np.polynomial.legendre.leggauss(200)
    exact = 0.4 * w @ tangent(0.4 * (x + 1))
    errors = []
    for n in (33, 65, 129):
        s = np.linspace(0, 0.8, n)
        errors.append(np.linalg.norm(curve_points(s, tangent(s), method=method)[-1] - exact))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert (ratios > 2 ** (order - 0.2)).all(), ratios
    assert order > 2 or (ratios < 2 ** (order + 0.2)).all(), ratios


def test_default_method_is_of_fourth_order_on_a_helix_to_its_ends() -> None:
    """Over five halvings of the spacing from 0.1 m on average, and within 0.1 over the last."""
    errors = []
    for n in (9, 17, 33, 65, 129, 257):
        s = np.linspace(0, 0.8, n)
        points, tangent = helix(s, 0.1, 0.03)
        errors.append(np.abs(curve_points(s, tangent) - points).max())
    order = np.log2(errors[0] / errors[-1]) / 5
    assert order > 4
    assert np.log2(errors[-2] / errors[-1]) > 3.9


@pytest.mark.parametrize("scene", ["sea", "wing", "breath"])
def test_order_on_scenes(scene: str) -> None:
    """Twice as many nodes: the hermite error falls by 4 within 15 %, the default's by at least 2^4."""
    _, ribbons = combs.reference_and_ribbons(scene, 3, 0.0125, 61, [0, 24])
    found = {}
    for method in ("hermite", "spline"):
        errors = []
        for step in (4, 2):
            tangent = np.ascontiguousarray(ribbons.tangent[:, :, ::step])
            points = curve_points(0.0125 * step * np.arange(60 // step + 1), tangent, method=method)
            truth = ribbons.position_m[:, :, ::step] - ribbons.position_m[:, :, :1]
            errors.append(np.linalg.norm(points - truth, axis=-1).mean())
        found[method] = errors[0] / errors[1]
    assert found["hermite"] == pytest.approx(4, rel=0.15)
    assert found["spline"] > 16


def measured_length(s: np.ndarray, tangent: np.ndarray, method: str) -> float:
    """Length from the anchor to the last node, of chords, extrapolated to chords without length."""
    lengths = []
    for chords in (64, 128, 256):
        pieces = np.concatenate([[0.0], s])
        at = np.concatenate(
            [np.linspace(a, b, chords, endpoint=False) for a, b in pairwise(pieces)] + [s[-1:]]
        )
        lengths.append(
            np.linalg.norm(np.diff(curve_points(s, tangent, at, method=method), axis=0), axis=1).sum()
        )
    coarse, fine = (4 * lengths[1] - lengths[0]) / 3, (4 * lengths[2] - lengths[1]) / 3
    return float((16 * fine - coarse) / 15)


@pytest.mark.parametrize("method", ["spline", "spherical"])
@pytest.mark.parametrize("scene", ["sea", "wing", "breath"])
def test_curve_on_a_scene_has_exact_length(method: str, scene: str, true_comb) -> None:
    """1e-12 relative: ribbon 2 of the comb, 0.775 m."""
    s = combs.LAYOUT.node_s_m
    tangent = reference.rotation(true_comb(scene).q_world_node[1, 2])[:, :, 0].copy()
    assert measured_length(s, tangent, method) == pytest.approx(s[-1], rel=1e-12)


@pytest.mark.parametrize("method", ["spline", "spherical"])
def test_curve_of_a_crumpled_ribbon_has_exact_length(method: str) -> None:
    """1e-9 relative where the ribbon turns by 25 degrees, anywhere, from node to node."""
    rng = np.random.default_rng(17)
    s = 0.025 * (2 * np.arange(16) + 1.0)
    tangent = reference.rotation(combs.random_ribbon(rng, 16, 0.25))[:, :, 0].copy()
    assert measured_length(s, tangent, method) == pytest.approx(s[-1], rel=1e-9)


@pytest.mark.parametrize("method", ["spline", "hermite", "spherical"])
def test_rotating_the_tangents_rotates_the_curve(method: str) -> None:
    """To 1e-12 m."""
    rng = np.random.default_rng(13)
    s = 0.025 * (2 * np.arange(16) + 1.0)
    tangent = reference.rotation(combs.random_ribbon(rng, 16, 0.3))[:, :, 0]
    turned = reference.rotation(combs.random_ribbon(rng, 1, 1.0)[0])
    straight, rotated = curve_points(s, np.stack([tangent, tangent @ turned.T]), method=method)
    np.testing.assert_allclose(rotated, straight @ turned.T, atol=1e-12)


@pytest.mark.parametrize("method", ["spline", "hermite", "spherical"])
def test_straight_ribbon_is_straight(method: str) -> None:
    """Repeated tangents: 1e-15 m."""
    s = np.linspace(0.02, 0.75, 16)
    tangent = np.tile(np.array([0.6, 0.0, 0.8]), (16, 1))
    np.testing.assert_allclose(curve_points(s, tangent, method=method), s[:, None] * tangent, atol=1e-15)


@pytest.mark.parametrize(
    ("method", "tolerance_m"), [("spline", 2e-6), ("hermite", 1e-5), ("spherical", 3e-4)]
)
def test_half_circle_over_many_nodes(method: str, tolerance_m: float) -> None:
    """A turn by 180 degrees over 0.75 m with 16 nodes, radius 0.24 m."""
    s = np.linspace(0, 0.75, 16)
    angle = np.pi * s / 0.75
    tangent = np.stack([np.cos(angle), np.sin(angle), 0 * s], axis=1)
    exact = 0.75 / np.pi * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * s], axis=1)
    np.testing.assert_allclose(curve_points(s, tangent, method=method), exact, atol=tolerance_m)


@pytest.mark.parametrize("method", ["spline", "hermite"])
@pytest.mark.parametrize("turn_deg", [170, 179, 179.9999, 180])
def test_sharp_and_opposite_turns_stay_finite(method: str, turn_deg: float) -> None:
    """One turn by up to 180 degrees between two nodes: no point is further off than its arc length."""
    s = np.linspace(0.025, 0.775, 16)
    angle = np.where(np.arange(16) < 8, 0.0, np.radians(turn_deg))
    tangent = np.stack([np.cos(angle), np.sin(angle), 0 * s], axis=1)
    points = curve_points(s, tangent, method=method)
    assert np.isfinite(points).all()
    assert (np.linalg.norm(points, axis=1) <= s * (1 + 1e-9)).all()


def test_spherical_start_gives_up_on_opposite_tangents_of_that_frame_only() -> None:
    s = np.linspace(0, 0.15, 4)
    tangent = np.tile(np.array([1.0, 0, 0]), (2, 4, 1))
    tangent[0, 2:] *= -1
    points = curve_points(s, tangent, method="spherical")
    assert np.isnan(points[0, 1:]).all()
    np.testing.assert_allclose(points[1, -1], [0.15, 0, 0], atol=1e-15)


def test_bending_of_a_helix() -> None:
    """Curvature r / (r^2 + p^2), torsion p / (r^2 + p^2) inside the ribbon: 0.5 % with 2 cm nodes."""
    s = np.linspace(0, 0.6, 31)
    _, tangent = helix(s, 0.1, 0.03)
    curvature, torsion = curve_bending(s, tangent)
    assert curvature.shape == torsion.shape == (61,)
    np.testing.assert_allclose(curvature[6:-6], 0.1 / 0.0109, rtol=5e-3)
    np.testing.assert_allclose(torsion[6:-6], 0.03 / 0.0109, rtol=5e-3)
    mirrored = curve_bending(s, np.ascontiguousarray(tangent * [1, 1, -1]))[1]
    np.testing.assert_allclose(mirrored, -torsion, rtol=1e-9)


def test_bending_agrees_with_reference() -> None:
    """Relative 1e-5; the reference takes differences."""
    rng = np.random.default_rng(19)
    s = np.cumsum(rng.uniform(0.03, 0.06, 9))
    tangent = reference.rotation(combs.random_ribbon(rng, 9, 0.2))[:, :, 0].copy()
    middle = (s[:-1] + s[1:]) / 2
    curvature, torsion = curve_bending(s, tangent)
    expected_curvature, expected_torsion = reference.bending(s, tangent, middle)
    np.testing.assert_allclose(curvature[1::2], expected_curvature, rtol=1e-5)
    np.testing.assert_allclose(torsion[1::2], expected_torsion, rtol=1e-4, atol=1e-5)


def test_straight_ribbon_has_no_bending() -> None:
    tangent = np.tile(np.array([0.0, 0.6, 0.8]), (5, 1))
    curvature, torsion = curve_bending(np.linspace(0, 0.2, 5), tangent)
    assert np.abs(curvature).max() < 1e-12
    assert np.isfinite(torsion).all()


def test_batch_is_each_frame_alone() -> None:
    rng = np.random.default_rng(20)
    s = np.linspace(0.025, 0.775, 16)
    tangent = np.stack([reference.rotation(combs.random_ribbon(rng, 16, 0.3))[:, :, 0] for _ in range(6)])
    for method in ("spline", "hermite", "spherical"):
        batch = curve_points(s, tangent.reshape(2, 3, 16, 3), s[3:9] + 0.01, method=method)
        alone = np.stack([curve_points(s, t, s[3:9] + 0.01, method=method) for t in tangent])
        np.testing.assert_array_equal(batch.reshape(alone.shape), alone)


def test_no_frames_give_no_curves() -> None:
    s = np.linspace(0.025, 0.775, 16)
    assert curve_points(s, np.empty((0, 16, 3))).shape == (0, 16, 3)
    assert curve_points(s, np.empty((2, 0, 16, 3)), s[:4].copy()).shape == (2, 0, 4, 3)
    assert curve_bending(s, np.empty((0, 16, 3)))[0].shape == (0, 31)


def test_blocks_of_a_batch_are_seamless() -> None:
    """More frames than are worked on at once, the last block not full: each as if alone."""
    rng = np.random.default_rng(22)
    s = np.linspace(0.025, 0.775, 16)
    tangent = combs.random_directions(rng, 1, 1) + 0.1 * rng.normal(size=(1300, 16, 3))
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    for at in (None, np.array([0.1, 0.7])):
        batch = curve_points(s, tangent, at)
        for f in (0, 511, 512, 1024, 1299):
            np.testing.assert_array_equal(batch[f], curve_points(s, tangent[f], at))


def test_curves_name_bad_arguments() -> None:
    s = np.linspace(0.025, 0.775, 16)
    tangent = np.tile(np.array([1.0, 0, 0]), (16, 1))
    for bad_s, word in [
        (s[::-1].copy(), "node_s_m"),
        (s - 1, "node_s_m"),
        (s * np.nan, "node_s_m"),
        (s[:15].copy(), "tangent"),
        (s[:1].copy(), "node_s_m"),
        (s[::2], "node_s_m"),
        (np.zeros(16), "node_s_m"),
    ]:
        with pytest.raises(ValueError, match=word):
            curve_points(bad_s, tangent)
    for bad, error, word in [
        (tangent * 2, ValueError, "tangent"),
        (tangent * np.nan, ValueError, "tangent"),
        (np.full_like(tangent, np.inf), ValueError, "tangent"),
        (tangent.astype(np.float32), TypeError, "tangent"),
        (tangent.astype(int), TypeError, "tangent"),
        (np.asfortranarray(tangent), ValueError, "tangent"),
        (tangent[:, :2].copy(), ValueError, "tangent"),
        (tangent.tolist(), TypeError, "tangent"),
    ]:
        with pytest.raises(error, match=word):
            curve_points(s, bad)
        with pytest.raises(error, match=word):
            curve_bending(s, bad)
    for bad_at in (np.array([0.776]), np.array([-1e-9]), np.array([np.nan])):
        with pytest.raises(ValueError, match="at_s_m"):
            curve_points(s, tangent, bad_at)
    with pytest.raises(ValueError, match="method"):
        curve_points(s, tangent, method="guess")  # type: ignore[arg-type]
