"""Motion in the product: estimated live, replayed as it was, and made again two-sided."""

from pathlib import Path

import numpy as np
import pytest
from record.test_replay import assert_same
from record.virtual import stream_virtually
from ribbonhost.pipeline.poses import MotionMode
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.solving import Solved
from ribbonhost.reconstruct import error_percent
from ribbonhost.record import Recording

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


def test_a_wing_of_two_seconds_is_followed_replayed_to_the_last_bit_and_bettered_from_both_sides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    live = stream_virtually(path, monkeypatch, seconds=2.0, period_s=PERIOD_S, motion="live", truth=True)
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

    _, smoothed = replayed(path, "offline")
    _, level = replayed(path, "off")
    assert mean_error_percent(smoothed, live) <= 0.05
    # Of other moments than the readings', so that there is no truth of them; but far from where they lead.
    assert len(level) > 200
    assert all(frame.motion is None for frame in level)
