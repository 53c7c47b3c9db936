"""Scans become frames of the comb: complete ones at once, late ribbons never delay the others."""

import numpy as np
import pytest
from numpy.typing import NDArray
from ribbonhost.device import Scan
from ribbonhost.pipeline.matching import SILENT_S, Match, Matcher, interpolate

PERIOD_S = 0.01


def turned(angle_rad: float, nodes: int = 2) -> NDArray[np.float64]:
    """Nodes that are turned about z."""
    return np.tile([np.cos(angle_rad / 2), 0, 0, np.sin(angle_rad / 2)], (nodes, 1))


def scan(t_s: float, angle_rad: float = 0.0, valid: tuple[bool, bool] = (True, True)) -> Scan:
    q = turned(angle_rad)
    return Scan(0, round(t_s * 1e6), t_s, t_s, q, np.array(valid), np.zeros(2, np.uint8))


def add(matcher: Matcher, ribbon: int, t_s: float, angle_rad: float = 0.0) -> list[Match]:
    return matcher.add(ribbon, scan(t_s, angle_rad), t_s)


@pytest.fixture
def three() -> Matcher:
    """Three live ribbons, after a match at t = 0."""
    matcher = Matcher(3, 2, PERIOD_S)
    for ribbon in range(3):
        add(matcher, ribbon, -PERIOD_S)
    for ribbon in range(3):
        add(matcher, ribbon, 0.0)
    return matcher


def test_a_match_is_complete_when_the_last_live_ribbon_delivers(three: Matcher) -> None:
    assert add(three, 0, 0.0100) == []
    assert add(three, 2, 0.0102) == []
    [match] = add(three, 1, 0.0101)
    assert match.t_host_s == 0.0100
    assert set(match.scans) == {0, 1, 2}
    assert match.valid.all()
    assert not three.held.any()


def test_orientations_are_those_of_the_oldest_new_scan(three: Matcher) -> None:
    add(three, 0, 0.0100, 0.2)
    add(three, 1, 0.0105, 0.2)
    [match] = add(three, 2, 0.0125, 0.2)
    expected_rad = np.array([0.2, 0.2 * 100 / 105, 0.2 * 100 / 125])
    angles_rad = 2 * np.arctan2(match.q_world_node[:, 0, 3], match.q_world_node[:, 0, 0])
    np.testing.assert_allclose(angles_rad, expected_rad, atol=1e-4)


def test_a_second_scan_does_not_wait_for_a_late_ribbon(three: Matcher) -> None:
    add(three, 0, 0.01)
    add(three, 1, 0.01)
    [match] = add(three, 0, 0.02)
    assert match.t_host_s == 0.01
    assert set(match.scans) == {0, 1}
    assert match.valid[2].all(), "its newest scan is held"
    assert three.held.tolist() == [0, 0, 1]


def test_a_late_scan_does_not_delay_the_matches_after_it(three: Matcher) -> None:
    """After a hiccup of one ribbon all are in step again, not one period behind."""
    add(three, 0, 0.01)
    add(three, 1, 0.01)
    assert len(add(three, 0, 0.02)) == 1
    assert add(three, 1, 0.02) == []
    assert add(three, 2, 0.01) == [], "too late to be new"
    [match] = add(three, 2, 0.02)
    assert match.t_host_s == 0.02
    for ribbon in (2, 1):
        assert add(three, ribbon, 0.03) == []
    [match] = add(three, 0, 0.03)
    assert match.t_host_s == 0.03


def test_a_lost_scan_costs_one_held_frame(three: Matcher) -> None:
    matches = []
    for k in range(1, 11):
        for ribbon in range(3):
            if (k, ribbon) != (5, 1):
                matches += add(three, ribbon, k * PERIOD_S)
    assert [round(match.t_host_s / PERIOD_S) for match in matches] == list(range(1, 11))
    assert three.held.tolist() == [0, 1, 0]


def test_a_silent_ribbon_is_not_waited_for_and_comes_back(three: Matcher) -> None:
    silent = []
    for k in range(1, 100):
        t_s = k * PERIOD_S
        add(three, 0, t_s)
        matches = add(three, 2, t_s)
        silent += three.expire(t_s)
        if t_s > SILENT_S + 2 * PERIOD_S:
            [match] = matches
            assert match.t_host_s == t_s
            assert match.valid.any(axis=1).tolist() == [True, False, True]
    assert silent == [1]
    held = three.held.tolist()
    assert add(three, 0, 1.0) == []
    assert add(three, 1, 1.0, 1.5) == []
    [match] = add(three, 2, 1.0)
    assert match.valid.all()
    np.testing.assert_allclose(match.q_world_node[1], turned(1.5), atol=1e-12)
    assert three.held.tolist() == held


def test_ribbons_that_scan_whenever_they_like_are_matched_once_a_period() -> None:
    """Phases drift through each other: no frame is missed, none is made twice."""
    matcher = Matcher(3, 2, PERIOD_S)
    periods_s = [PERIOD_S, PERIOD_S * (1 + 2e-3), PERIOD_S * (1 - 2e-3)]
    events = sorted((k * p + 0.003 * r, r) for r, p in enumerate(periods_s) for k in range(1000))
    times_s = [match.t_host_s for t_s, r in events for match in add(matcher, r, t_s)]
    assert len(times_s) == pytest.approx(1000, abs=5)
    assert (np.diff(times_s) > PERIOD_S / 2).all()


def test_interpolation_follows_the_short_way_whatever_the_signs() -> None:
    q = np.stack([turned(0.0)[None], -turned(0.1)[None]])
    mixed, _ = interpolate(np.array([[0.0], [1.0]]), q, np.ones((2, 1, 2), bool), 0.25)
    expected = turned(0.025)
    np.testing.assert_allclose(np.abs(np.einsum("ni,ni->n", mixed[0], expected)), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(mixed, axis=-1), 1.0, atol=1e-12)


def test_interpolation_differs_from_the_great_arc_by_less_than_the_noise() -> None:
    """A turn by 3 rad/s, scanned 100 times a second."""
    q = np.stack([turned(0.0)[None], turned(0.03)[None]])
    mixed, _ = interpolate(np.array([[0.0], [0.01]]), q, np.ones((2, 1, 2), bool), 0.0025)
    angle_rad = 2 * np.arctan2(mixed[0, 0, 3], mixed[0, 0, 0])
    assert angle_rad == pytest.approx(0.0075, abs=1e-6)


@pytest.mark.parametrize("at_s", [-1.0, 2.0])
def test_nothing_is_extrapolated(at_s: float) -> None:
    q = np.stack([turned(0.0)[None], turned(0.5)[None]])
    mixed, _ = interpolate(np.array([[0.0], [1.0]]), q, np.ones((2, 1, 2), bool), at_s)
    np.testing.assert_allclose(mixed[0], turned(0.0 if at_s < 0 else 0.5), atol=1e-12)


def test_an_invalid_node_does_not_spoil_the_scan_after_it() -> None:
    older = turned(0.0)
    older[1] = np.nan
    q = np.stack([older[None], turned(0.5)[None]])
    valid = np.array([[[True, False]], [[True, True]]])
    mixed, mixed_valid = interpolate(np.array([[0.0], [1.0]]), q, valid, 0.5)
    assert mixed_valid.all()
    np.testing.assert_allclose(mixed[0, 1], turned(0.5)[1], atol=1e-12)
    np.testing.assert_allclose(mixed[0, 0], turned(0.25)[0], atol=1e-12)


def test_a_node_that_became_invalid_is_invalid() -> None:
    q = np.stack([turned(0.0)[None], turned(0.5)[None]])
    valid = np.array([[[True, True]], [[True, False]]])
    assert interpolate(np.array([[0.0], [1.0]]), q, valid, 0.5)[1].tolist() == [[True, False]]
