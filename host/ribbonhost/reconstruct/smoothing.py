"""Temporal smoothing of orientations: with a stated delay for live use, without one for recordings."""

import numpy as np

from ribbonhost.native._native import ffi, lib
from ribbonhost.reconstruct import arguments
from ribbonhost.reconstruct.arguments import Bool, Float64, doubles

# Where the gain of two equal first-order low-passes in a row is 1/sqrt(2), as 2 pi f tau; and where it is if
# they run once forward and once backward.
_CAUSAL_CUTOFF = np.sqrt(np.sqrt(2.0) - 1)
_TWO_WAY_CUTOFF = np.sqrt(2.0**0.25 - 1)


def _smooth(t_s: Float64, tau_s: float, q: Float64, valid: Bool, state: Float64) -> Float64:
    out = np.empty_like(q)
    code = lib.ribbon_smooth(
        len(t_s),
        valid.size // len(t_s),
        doubles(t_s),
        tau_s,
        doubles(q),
        ffi.from_buffer("uint8_t[]", valid),
        doubles(state),
        doubles(out),
    )
    arguments.raise_for(code, {lib.RIBBON_ERROR_NOT_INCREASING: "t_s", lib.RIBBON_ERROR_NOT_FINITE: "t_s"})
    return out


def _checked(q_world_node: object, valid: object, *shape: int | str) -> tuple[Float64, Bool]:
    q = arguments.floats("q_world_node", q_world_node, *shape, 4)
    flags = arguments.flags("valid", valid, *q.shape[:-1])
    arguments.unit("q_world_node", q[flags])
    return q, flags


def _cutoff(cutoff_hz: float) -> float:
    if not (np.isfinite(cutoff_hz) and cutoff_hz > 0):
        raise ValueError(f"cutoff_hz must be a positive frequency, not {cutoff_hz}")
    return 2 * np.pi * cutoff_hz


class LiveSmoother:
    """Smooths the orientations of a comb or ribbon, frame by frame, by two equal first-order low-passes.

    cutoff_hz: frequency at which a wave keeps 1/sqrt(2) of its amplitude. shape: axes of one frame of
    `valid`, such as (R + 1, n). delay_s: by how much a steady motion comes out late, whatever the
    spacing of the frames: what is given for time t is the state at t - delay_s.
    Raises ValueError naming the argument.
    """

    def __init__(self, cutoff_hz: float, shape: tuple[int, ...]) -> None:
        self._tau_s = float(_CAUSAL_CUTOFF / _cutoff(cutoff_hz))
        self.delay_s = 2 * self._tau_s
        self._shape = shape
        self._state = np.full((*shape, lib.RIBBON_SMOOTH_STATE), np.nan)

    def smooth(self, t_s: float, q_world_node: Float64, valid: Bool) -> Float64:
        """Smoothed orientations (*shape, 4) after the frame at t_s, seconds.

        q_world_node: (*shape, 4) unit, valid: (*shape). A node that is invalid keeps its last output,
        NaN before its first, and goes on from there. Raises TypeError or ValueError naming the
        argument; t_s must grow.
        """
        q, flags = _checked(q_world_node, valid, *self._shape)
        t = np.array([t_s], np.float64)
        smoothed: Float64 = _smooth(t, self._tau_s, q[None], flags[None], self._state)[0]
        return smoothed

    def noise_gain(self, period_s: float) -> float:
        """Standard deviation of the output over that of white noise, for frames period_s apart."""
        if not (np.isfinite(period_s) and period_s > 0):
            raise ValueError(f"period_s must be a positive time, not {period_s}")
        return _noise_gain(self._tau_s, period_s)


def _noise_gain(tau_s: float, period_s: float) -> float:
    """From the response to one small turn."""
    frames = 2 + int(np.ceil(20 * tau_s / period_s))
    q = np.tile([1.0, 0, 0, 0], (frames + 1, 1, 1))
    q[1, 0] = np.cos(1e-6), np.sin(1e-6), 0, 0
    t_s = np.arange(frames + 1, dtype=np.float64) * period_s
    state = np.full((1, lib.RIBBON_SMOOTH_STATE), np.nan)
    response = _smooth(t_s, tau_s, q, np.ones((frames + 1, 1), np.bool_), state)[:, 0, 1] / np.sin(1e-6)
    return float(np.sqrt(np.sum(response**2)))


def smooth_recording(t_s: Float64, q_world_node: Float64, valid: Bool, cutoff_hz: float) -> Float64:
    """Smoothed orientations (frames, ..., 4) of a recording: the same filter forward and backward, no delay.

    t_s: (frames,) seconds, increasing. q_world_node: (frames, ..., 4) unit, valid: (frames, ...).
    cutoff_hz: where a wave keeps 1/sqrt(2) of its amplitude. What is invalid is bridged in time; it
    stays to be marked invalid, or not. A node that is never valid is NaN. Raises TypeError or
    ValueError naming the argument.
    """
    t_s = arguments.finite("t_s", arguments.floats("t_s", t_s, None))
    if not (np.diff(t_s) > 0).all():
        raise ValueError("t_s must grow from frame to frame")
    tau_s = float(_TWO_WAY_CUTOFF / _cutoff(cutoff_hz))
    q, flags = _checked(q_world_node, valid, "...")
    if len(q) != len(t_s):
        raise ValueError(f"q_world_node must have as many frames as t_s, {len(t_s)}, not {len(q)}")
    state = np.full((q[0].size // 4, lib.RIBBON_SMOOTH_STATE), np.nan)
    forward = _smooth(t_s, tau_s, q, flags, state)
    known = np.isfinite(forward[..., 0])
    state[:] = np.nan
    backward = _smooth(
        np.ascontiguousarray(-t_s[::-1]),
        tau_s,
        np.ascontiguousarray(forward[::-1]),
        np.ascontiguousarray(known[::-1]),
        state,
    )
    return np.ascontiguousarray(backward[::-1])
