"""Motion in the product: estimated live, replayed as it was, and made again two-sided."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record.test_replay import assert_same
from record.virtual import stream_virtually
from ribbonhost import wire
from ribbonhost.cli.collect import collect
from ribbonhost.device import Scan
from ribbonhost.device.pairing import Pairing
from ribbonhost.motion.model import radius_95_m
from ribbonhost.pipeline.poses import MotionMode
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.solving import Solved
from ribbonhost.reconstruct import error_percent
from ribbonhost.record import Recording
from scipy.interpolate import CubicSpline

PERIOD_S = 2.0
SETTLED_S = 0.5
LENGTH_M = 31 * 0.025


def replayed(path: Path, motion: MotionMode | None = None) -> tuple[Replay, list[Solved]]:
    solved: list[Solved] = []
    replay = Replay([Recording(path)], motion=motion, on_solved=[solved.append])
    for _ in replay.play():
        pass
    return replay, solved


def mean_error_percent(frames: list[Solved], truth: list[Solved]) -> float:
    """Mean E of frames of the moments of others, which know the truth."""
    known = {frame.match.t_host_s: frame.truth_m for frame in truth}
    errors = [
        error_percent(frame.node_m[1:], known[frame.match.t_host_s][1:], LENGTH_M)
        for frame in frames
        if frame.match.t_host_s in known
    ]
    assert len(errors) > 100
    return float(np.mean(errors))


def lag_s(frames: list[Solved]) -> float:
    """By how much frames show what was true earlier than they say."""
    t_s = np.array([frame.match.t_host_s for frame in frames])
    true_m = np.array([frame.truth_m for frame in frames])
    velocity_mps = np.gradient(true_m, t_s, axis=0)
    off_m = true_m - np.array([frame.node_m for frame in frames])
    return float(np.sum(velocity_mps * off_m) / np.sum(velocity_mps**2))


def test_a_comb_of_five_is_followed_replayed_to_the_last_bit_and_bettered_from_both_sides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    live = stream_virtually(
        path, monkeypatch, seconds=1.8, ribbons=5, period_s=PERIOD_S, motion="live", truth=True
    )
    first_s = live[0].match.t_host_s
    counted = [frame for frame in live if frame.match.t_host_s > first_s + SETTLED_S]
    assert mean_error_percent(counted, live) <= 0.12

    replay, again = replayed(path)
    assert replay.motion == "live"
    again = [frame for frame in again if frame.match.t_host_s >= first_s]
    assert_same(live, again)
    for one, other in zip(live, again, strict=True):
        assert one.motion is not None
        assert other.motion is not None
        np.testing.assert_array_equal(one.motion.velocity_mps, other.motion.velocity_mps)
        np.testing.assert_array_equal(one.match.sigma_rad, other.match.sigma_rad)
    assert all(ribbon.motion and ribbon.motion.level == 0 for ribbon in replay.report().ribbons)

    assert abs(lag_s(counted)) < 0.001

    animation, _ = collect([Recording(path)], lambda share: None, motion="offline", with_surface=False)
    assert animation.motion is not None
    # Two-sided estimates are of the moments of the readings, live ones of the ends of the scans.
    live_s = np.array([frame.match.t_host_s for frame in live]) - replay.t_zero_s
    true_at = CubicSpline(live_s, np.array([frame.truth_m for frame in live]))
    errors = [
        error_percent(node_m[1:], true_at(t_s)[1:], LENGTH_M)
        for t_s, node_m in zip(animation.t_s.tolist(), animation.node_m, strict=True)
        if live_s[0] <= t_s <= live_s[-1]
    ]
    assert len(errors) > 100
    assert np.mean(errors) <= 0.05
    speed_mps = np.gradient(animation.node_m, animation.t_s, axis=0)[10:-10]
    velocity_mps = animation.motion.velocity_mps[10:-10]
    # The derivative of positions has their noise; a wrong frame or a missing anchor would cost the whole.
    assert np.sqrt(np.mean((velocity_mps - speed_mps) ** 2)) < 0.1 * np.abs(speed_mps).max()
    true_m = np.array([frame.truth_m for frame in live])
    off_m = np.linalg.norm(np.array([frame.node_m for frame in live]) - true_m, axis=-1)
    radius_m = np.array([radius_95_m(f.motion.position_covariance_m2) for f in live if f.motion])
    assert np.mean(off_m < radius_m) > 0.8

    _, level = replayed(path, "off")
    assert len(level) > 200
    assert all(frame.motion is None for frame in level)
    level = [frame for frame in level if frame.match.t_host_s > first_s + SETTLED_S]
    assert mean_error_percent(level, live) > 3 * mean_error_percent(counted, live)


def test_readings_that_do_not_come_are_bridged_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One RAW in ten, and then a quarter of a second of them."""
    take_raw = Pairing.take_raw
    taken = 0

    def lose(self: Pairing, raw: wire.Raw, *arguments: Any) -> list[Scan]:
        nonlocal taken
        taken += 1
        lost = taken % 10 == 5 or 450 <= taken < 525
        return [] if lost else take_raw(self, raw, *arguments)

    monkeypatch.setattr(Pairing, "take_raw", lose)
    path = tmp_path / "a.mcap"
    live = stream_virtually(
        path, monkeypatch, seconds=1.5, ribbons=2, period_s=PERIOD_S, motion="live", truth=True
    )
    before = [
        f for f in live if live[0].match.t_host_s + 0.4 < f.match.t_host_s < live[0].match.t_host_s + 0.9
    ]
    errors = [error_percent(f.node_m[1:], f.truth_m[1:], LENGTH_M) for f in before if f.truth_m is not None]
    assert np.mean(errors) < 0.2
    taken = 0
    replay, _ = replayed(path)
    for ribbon in replay.report().ribbons:
        assert ribbon.motion is not None
        assert ribbon.motion.predicted > 10
        assert ribbon.motion.level > 5
        assert ribbon.motion.estimated > 100
        assert 20 < ribbon.counters.raw_lost <= ribbon.motion.predicted + ribbon.motion.level
