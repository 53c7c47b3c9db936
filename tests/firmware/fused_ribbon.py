"""The firmware's fusion fed from Python: a ribbon of given orientations, its sensors, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from firmware.c_arrays import view
from firmware.rotations import Array, angle_deg, field_world_ut, matrices
from numpy.typing import NDArray
from ribbonhil._firmware import ffi, lib

NODES: int = lib.RIBBON_NODE_COUNT
GRAVITY_MPS2 = 9.80665
FIELD_UT = field_world_ut()

MOVING = lib.WIRE_QUALITY_MOVING
FIELD_MAGNITUDE = lib.WIRE_QUALITY_FIELD_MAGNITUDE
FIELD_DIP = lib.WIRE_QUALITY_FIELD_DIP
AMBIGUOUS = lib.WIRE_QUALITY_HEADING_AMBIGUOUS


@dataclass(frozen=True)
class Oriented:
    """One scan's result: q (N, 4), sigma_deg (N,), flags (N,), valid (N,)."""

    q: Array
    sigma_deg: Array
    flags: NDArray[np.uint8]
    valid: NDArray[np.bool_]


class Fusion:
    """Params, state and derived of one ribbon, and the input that the next scan is made of."""

    def __init__(self, *, two_axes: bool = False, rate_hz: float = 100.0) -> None:
        self.params = ffi.new("struct fusion_params *")
        self.state = ffi.new("struct fusion_state *")
        self.derived = ffi.new("struct fusion_derived *")
        self.input = ffi.new("struct fusion_input *")
        self._nodes = ffi.new("struct fusion_node[]", NODES)
        lib.fusion_params_default(self.params)
        self.params.field_horizontal_ut = FIELD_UT[1]
        self.params.field_down_ut = -FIELD_UT[2]
        self.params.has_two_axes = two_axes
        self.reset()
        self.input.dt_s = 1 / rate_hz
        self.accel_mps2 = view(self.input.accel_mps2)
        self.field_ut = view(self.input.field_ut)
        self.accel_valid = view(self.input.accel_valid, np.bool_)
        self.field_valid = view(self.input.field_valid, np.bool_)
        self.accel_valid[:] = self.field_valid[:] = True
        view(self.input.accel_noise_mps2)[:] = 0.004
        view(self.input.field_noise_ut)[:] = 0.06

    def reset(self) -> None:
        lib.fusion_reset(self.params, self.state, self.derived)

    def scan(self, accel_mps2: Array, field_ut: Array) -> Oriented:
        """The orientations after one more scan with these readings, (N, 3) each.

        Two axes: without what the magnetometers are blind to.
        """
        self.accel_mps2[:], self.field_ut[:] = accel_mps2, field_ut
        if self.params.has_two_axes:
            blind = view(self.params.blind)
            with np.errstate(all="ignore"):  # garbage stays garbage
                self.field_ut[:] = field_ut - np.sum(field_ut * blind, axis=1, keepdims=True) * blind
        lib.fusion_update(self.params, self.state, self.derived, self.input, self._nodes)
        nodes = self._nodes
        return Oriented(
            q=np.array([list(node.q_world_node) for node in nodes]),
            sigma_deg=np.degrees([node.sigma_rad for node in nodes]),
            flags=np.array([node.flags for node in nodes], np.uint8),
            valid=np.array([node.valid for node in nodes], bool),
        )


def twisted(rng: np.random.Generator, turn_rad: float) -> tuple[Array, Array]:
    """Orientations of a smoothly bent ribbon at its accelerometers and its nodes, (N, 4) each.

    The tangent, and the ribbon around it, turn by up to `turn_rad` from one accelerometer to the next.
    """
    from scipy.spatial.transform import Rotation

    s = np.arange(2 * NODES)  # pitches
    phase = rng.uniform(0, 2 * np.pi, 3)
    rate = turn_rad / 2 * rng.uniform(0.5, 1, 3) / np.sqrt(3)
    step = np.stack([rate[i] * np.sin(2 * np.pi * s / 24 + phase[i]) for i in range(3)], -1)
    start = Rotation.random(random_state=int(rng.integers(2**31)))
    turned, rotation = [], start
    for vector in step:
        turned.append(rotation)
        rotation = rotation * Rotation.from_rotvec(vector)
    q = np.roll(np.array([r.as_quat() for r in turned]), 1, axis=1)
    return q[0::2], q[1::2]


def readings(q_accels: Array, q_nodes: Array) -> tuple[Array, Array]:
    """What ideal sensors at rest read, (N, 3) each."""
    up = np.array([0, 0, GRAVITY_MPS2])
    accel = np.einsum("nji,j->ni", matrices(q_accels), up)
    field = np.einsum("nji,j->ni", matrices(q_nodes), FIELD_UT)
    return accel, field


def errors_deg(result: Oriented, q_nodes: Array) -> Array:
    """(N,) angle between what came out and the truth, NaN where not valid."""
    return np.where(result.valid, angle_deg(result.q, q_nodes), np.nan)
