"""The hermite update: its closed form against the paper's minimisation, its length, and its corner cases."""

import numpy as np
import pytest
from reconstruct import combs
from ribbonhost.native._native import ffi, lib
from ribbonhost.reconstruct import reference
from ribbonhost.reconstruct.curve import curve_points
from scipy.optimize import minimize


def node_positions(node_s_m: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    return curve_points(node_s_m, tangent, method="hermite")


def turn(angle_rad: float) -> np.ndarray:
    """Two unit tangents (2, 3) with that angle between them, in general position."""
    axis_frame = np.linalg.qr(np.array([[1.0, 2, 3], [2, -1, 0.5], [0.3, 0.7, 1]]))[0]
    half = angle_rad / 2
    return np.array([[np.cos(half), np.sin(half), 0], [np.cos(half), -np.sin(half), 0]]) @ axis_frame


@pytest.mark.parametrize("angle_deg", [0, 1e-6, 1, 30, 60, 89.999, 90, 90.001, 120, 150, 170, 178, 179.99])
def test_segment_has_exact_length(angle_deg: float) -> None:
    """Arc length 50 mm to 1e-12 relative at every turn."""
    tangent = turn(np.radians(angle_deg))
    end = node_positions(np.array([0.0, 0.05]), tangent[None])[0, 1]
    length = reference.segment_length(np.zeros(3), end, tangent[0], tangent[1], 0.05)
    assert length == pytest.approx(0.05, rel=1e-12)


@pytest.mark.parametrize("angle_deg", [5.7, 28.6, 57.3, 86, 115, 143, 160, 172, 178])
def test_closed_form_is_the_papers_minimum(angle_deg: float) -> None:
    """SLSQP on the paper's own problem, from random starts, finds this chord within 1e-5 of it."""
    t0, t1 = turn(np.radians(angle_deg))
    chord = node_positions(np.array([0.0, 1.0]), np.array([[t0, t1]]))[0, 1]
    rng = np.random.default_rng(7)
    best = None
    for _ in range(3):
        found = minimize(
            lambda d: 12 * np.sum((d - (t0 + t1) / 2) ** 2),
            chord + 0.3 * rng.normal(size=3),
            constraints={
                "type": "eq",
                "fun": lambda d: reference.segment_length(np.zeros(3), d, t0, t1, 1.0) - 1,
            },
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 200},
        )
        if found.success and (best is None or found.fun < best.fun):
            best = found
    assert best is not None
    np.testing.assert_allclose(best.x, chord, atol=1e-5)


def test_gamma_agrees_with_quadrature_and_root_finding() -> None:
    """Relative 1e-12 over all cosines down to a turn of 179.9 degrees."""
    for c in np.cos(np.radians(np.linspace(0, 179.9, 60))):
        t0, t1 = turn(np.arccos(c))
        expected = np.linalg.norm(reference.segment_chord(t0, t1, 1.0)) / np.linalg.norm(t0 + t1)
        assert lib.ribbon_hermite_gamma(t0 @ t1) == pytest.approx(expected, rel=1e-12 / max(1 + c, 1e-3))


@pytest.mark.parametrize("first_s", [0.0, 0.02])
def test_update_agrees_with_reference(first_s: float) -> None:
    """Random uneven nodes, turns from gentle to beyond 90 degrees: 1e-12 m."""
    rng = np.random.default_rng(11)
    s = first_s + np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.08, 11))])
    for turn_rad in (0.05, 0.4, 1.0):
        tangent = reference.rotation(combs.random_ribbon(rng, 12, turn_rad))[:, :, 0]
        expected = reference.hermite_curve(s, tangent)
        np.testing.assert_allclose(node_positions(s, tangent[None].copy())[0], expected(s), atol=1e-12)


def test_points_on_the_curve_agree_with_reference() -> None:
    rng = np.random.default_rng(12)
    s = 0.025 * (2 * np.arange(16) + 1.0)
    tangent = reference.rotation(combs.random_ribbon(rng, 16, 0.2))[:, :, 0].copy()
    at = np.concatenate([rng.uniform(0, s[-1], 50), [0.0, s[0], s[7], s[-1]]])
    points = curve_points(s, tangent, at, method="hermite")
    np.testing.assert_allclose(points, reference.hermite_curve(s, tangent)(at), atol=1e-13)


def test_spiral_converges_with_second_order() -> None:
    """On a growing curvature halving the spacing divides the error by 4, within 5 %."""
    errors = []
    fine_s, fine_weight = np.polynomial.legendre.leggauss(100)
    for n in (11, 21, 41):
        s = np.linspace(0, 0.5, n)

        def tangent(at: np.ndarray) -> np.ndarray:
            return np.stack([np.cos(8 * at**2), np.sin(8 * at**2), np.zeros_like(at)], axis=1)

        exact = 0.25 * fine_weight @ tangent(0.25 * (fine_s + 1))
        errors.append(np.linalg.norm(node_positions(s, tangent(s)[None])[0, -1] - exact))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all(np.abs(ratios / 4 - 1) < 0.05), ratios


def test_straight_ribbon_is_straight() -> None:
    s = np.linspace(0, 0.75, 16)
    tangent = np.tile(np.array([0.6, 0.0, 0.8]), (1, 16, 1))
    np.testing.assert_allclose(node_positions(s, tangent)[0], s[:, None] * tangent[0], atol=1e-15)


def test_exactly_opposite_tangents_stay_finite_and_are_counted() -> None:
    s, tangent = np.array([0.0, 0.05]), np.array([[0.6, 0.0, 0.8], [-0.6, 0.0, -0.8]])
    position, knot_tangent = np.empty((2, 3)), np.empty((2, 3))
    pointers = [ffi.from_buffer("double[]", a) for a in (s, tangent, position, knot_tangent)]
    assert lib.ribbon_hermite_update(1, 2, *pointers) == 1
    assert reference.segment_length(position[0], position[1], *tangent, 0.05) == pytest.approx(
        0.05, rel=1e-12
    )
    assert abs(position[1] @ tangent[0]) < 1e-15


def test_rotating_the_tangents_rotates_the_curve() -> None:
    """To 1e-12 m."""
    rng = np.random.default_rng(13)
    s = 0.025 * (2 * np.arange(16) + 1.0)
    tangent = reference.rotation(combs.random_ribbon(rng, 16, 0.3))[:, :, 0]
    turned = reference.rotation(combs.random_ribbon(rng, 1, 1.0)[0])
    both = np.stack([tangent, tangent @ turned.T])
    straight, rotated = node_positions(s, both)
    np.testing.assert_allclose(rotated, straight @ turned.T, atol=1e-12)
