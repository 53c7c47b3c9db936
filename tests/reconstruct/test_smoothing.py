"""Smoothing over time: its delay, its cutoff, its noise, and what invalid frames do."""

import numpy as np
import pytest
from reconstruct import combs
from ribbonhost.reconstruct import LiveSmoother, reference, smooth_recording


def about_x(angle_rad: np.ndarray) -> np.ndarray:
    """(..., 4) turns about x."""
    zero = np.zeros_like(angle_rad)
    return np.stack([np.cos(angle_rad / 2), np.sin(angle_rad / 2), zero, zero], axis=-1)


def angle_of(q: np.ndarray) -> np.ndarray:
    return np.unwrap(2 * np.arctan2(q[..., 1], q[..., 0]), axis=0, period=2 * np.pi)


def run(smoother: LiveSmoother, t_s: np.ndarray, q: np.ndarray, valid: np.ndarray) -> np.ndarray:
    return np.stack([smoother.smooth(t, qi, vi) for t, qi, vi in zip(t_s, q, valid, strict=True)])


def test_live_smoother_agrees_with_reference() -> None:
    """Uneven frames, random signs: 1e-10."""
    rng = np.random.default_rng(61)
    t_s = np.cumsum(rng.uniform(0.005, 0.02, 60))
    q = combs.random_ribbon(rng, 60, 0.1)
    smoother = LiveSmoother(3.0, (1,))
    out = run(smoother, t_s, q[:, None], np.ones((60, 1), bool))[:, 0]
    same_side = q.copy()
    for k in range(1, 60):
        same_side[k] *= 1.0 if same_side[k] @ same_side[k - 1] >= 0 else -1.0
    expected = reference.smooth(t_s, same_side, smoother.delay_s / 2)
    np.testing.assert_allclose(np.abs(np.einsum("ki,ki->k", out, expected)), 1, atol=1e-10)


@pytest.mark.parametrize("period_s", [0.001, 0.01, 0.05, None])
def test_steady_turn_comes_out_late_by_the_stated_delay(period_s: float | None) -> None:
    """0.02 rad/s at any spacing of frames, even or not: the delay to 1 %."""
    rng = np.random.default_rng(62)
    t_s = np.cumsum(rng.uniform(0.001, 0.05, 400)) if period_s is None else period_s * np.arange(400.0)
    smoother = LiveSmoother(10.0, (1,))
    out = run(smoother, t_s, about_x(0.02 * t_s)[:, None], np.ones((400, 1), bool))
    late_s = t_s[-1] - angle_of(out[:, 0])[-1] / 0.02
    assert late_s == pytest.approx(smoother.delay_s, rel=0.01)


@pytest.mark.parametrize("kind", ["live", "recording"])
def test_wave_at_the_cutoff_keeps_its_share(kind: str) -> None:
    """5 Hz through a cutoff of 5 Hz: 1/sqrt(2) of the amplitude within 2 %, a recording without delay."""
    t_s = 0.005 * np.arange(800.0)
    wave = np.exp(2j * np.pi * 5 * t_s)
    q, valid = about_x(0.02 * wave.real)[:, None], np.ones((800, 1), bool)
    if kind == "live":
        out = run(LiveSmoother(5.0, (1,)), t_s, q, valid)
    else:
        out = smooth_recording(t_s, q, valid, 5.0)
    middle = slice(200, 600)
    response = np.mean(angle_of(out[:, 0])[middle] * wave.conj()[middle]) * 2 / 0.02
    assert abs(response) == pytest.approx(np.sqrt(0.5), rel=0.02)
    if kind == "recording":
        assert abs(np.angle(response)) < 1e-3


def test_noise_gain_is_what_noise_does() -> None:
    """Root mean square over 20,000 orientations, 2 %."""
    rng = np.random.default_rng(63)
    smoother = LiveSmoother(10.0, (200,))
    noise = 0.01 * rng.normal(size=(140, 200))
    out = run(smoother, 0.01 * np.arange(140.0), about_x(noise), np.ones((140, 200), bool))
    gain = angle_of(out)[40:].std() / 0.01
    assert smoother.noise_gain(0.01) == pytest.approx(gain, rel=0.02)
    assert gain < 0.6


def test_invalid_frames_hold_the_output_and_do_not_poison_it() -> None:
    t_s = 0.01 * np.arange(100.0)
    q = np.repeat(about_x(0.3 * t_s)[:, None], 2, axis=1)
    valid = np.ones((100, 2), bool)
    valid[:5, 1] = False
    valid[40:60, 1] = False
    q[~valid] = np.nan
    out = run(LiveSmoother(10.0, (2,)), t_s, q, valid)
    assert np.isnan(out[:5, 1]).all()
    assert np.isfinite(out[5:, 1]).all()
    np.testing.assert_array_equal(out[40:60, 1], np.repeat(out[39:40, 1], 20, axis=0))
    np.testing.assert_allclose(out[90:, 1], out[90:, 0], atol=1e-6)


def test_recording_is_bridged_in_time() -> None:
    """A gap of 0.2 s in a steady turn: 1e-6 rad; a node that is never valid stays NaN alone."""
    t_s = 0.01 * np.arange(200.0)
    q = np.repeat(about_x(0.3 * t_s)[:, None], 2, axis=1)
    valid = np.ones((200, 2), bool)
    valid[90:110, 0] = False
    valid[:, 1] = False
    q[~valid] = np.nan
    out = smooth_recording(t_s, q, valid, 10.0)
    before_and_after = np.r_[60:85, 115:140]
    np.testing.assert_allclose(angle_of(out[:, 0])[before_and_after], 0.3 * t_s[before_and_after], atol=1e-3)
    assert np.isnan(out[:, 1]).all()


def test_smoothers_name_bad_arguments() -> None:
    q, valid = np.tile([1.0, 0, 0, 0], (3, 1)), np.ones(3, bool)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="cutoff_hz"):
            LiveSmoother(bad, (3,))
        with pytest.raises(ValueError, match="cutoff_hz"):
            smooth_recording(np.arange(3.0), q[:, None], valid[:, None], bad)
        with pytest.raises(ValueError, match="period_s"):
            LiveSmoother(1.0, (3,)).noise_gain(bad)
    smoother = LiveSmoother(1.0, (3,))
    smoother.smooth(1.0, q, valid)
    for bad_t in (1.0, 0.5, np.nan):
        with pytest.raises(ValueError, match="t_s"):
            smoother.smooth(bad_t, q, valid)
    for bad_q, error in [
        (q * np.nan, ValueError),
        (q * 2, ValueError),
        (q[:2], ValueError),
        (q.tolist(), TypeError),
    ]:
        with pytest.raises(error, match="q_world_node"):
            smoother.smooth(2.0, bad_q, valid)
    with pytest.raises(TypeError, match="valid"):
        smoother.smooth(2.0, q, valid.astype(int))
    with pytest.raises(ValueError, match="t_s"):
        smooth_recording(np.array([0.0, 1.0, 1.0]), q, valid, 1.0)
    with pytest.raises(ValueError, match="q_world_node"):
        smooth_recording(np.arange(2.0), q, valid, 1.0)
