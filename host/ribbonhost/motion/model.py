"""What goes into the motion estimator and what comes out: parameters, samples and motion, as NumPy arrays."""

import dataclasses
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ribbonhost.native._native import ffi, lib

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

GRAVITY_MPS2 = 9.80665

NODE_MIN: int = lib.RIBBON_MOTION_NODE_MIN
NODE_MAX: int = lib.RIBBON_MOTION_NODE_MAX
"""Orientations of a ribbon that can be estimated."""


class Status(IntEnum):
    """How much there is to an estimate."""

    WAITING = lib.RIBBON_MOTION_WAITING  # nothing: no level reading to start from, or the sample was refused
    STARTED = lib.RIBBON_MOTION_STARTED  # from the level reading of this sample
    SETTLING = lib.RIBBON_MOTION_SETTLING  # started less than a third of a second ago
    TRACKING = lib.RIBBON_MOTION_TRACKING


@dataclass(frozen=True)
class MotionParams:
    """How a ribbon is built, how well it measures, and how it may move: one setting for all motions.

    node_count: orientations; accelerometers sit at slots 0, 2, 4 ..., magnetometers and nodes at 1, 3, 5 ...
    field_ut: (3,) local field in the world. field_axes: of a magnetometer, 2 or 3. field_normals: (n, 3) node
        frame, the direction in which one of two axes feels nothing; None: z, as of parts without tilt.
    accel_sigma_mps2, field_sigma_ut: noise of one axis of one sample; the true one, within a factor of two
        below and twenty above, is found from the samples.
    force_overlap: samples over which an accelerometer averages, 1 or more: so many share their noise.
    force_jitter_s: standard deviation of the instants at which the accelerometers sample, which run by
        clocks of their own. field_later_s: by which the magnetometers sample later on average.
    root_jerk, twist_jerk, bend_jerk: how fast the anchor's rotation (rad/s^3), the twist (rad/m/s^3) and the
        curvature (1/m/s^3) may change their ways, a root hertz; scaled to what the samples show.
    persistence_s: how long a rate or an acceleration lasts by itself.
    offset_persistence_s: how long what calibration has left of an accelerometer's error lasts; how large it
        is is found from the samples.
    anchor_sigma_mps2, anchor_low_hz, anchor_high_hz: strongest acceleration of an anchor that moves by
        itself, each axis, and its band; whether it moves is found from the samples.
    """

    node_count: int = 16
    pitch_m: float = 0.025
    gravity_mps2: float = GRAVITY_MPS2
    field_ut: tuple[float, float, float] = (0.0, 22.534, -42.381)
    field_axes: int = 2
    field_normals: tuple[tuple[float, float, float], ...] | None = None
    accel_sigma_mps2: float = 0.6e-3 * GRAVITY_MPS2
    field_sigma_ut: float = 0.0012 * 48.0
    force_overlap: float = 1.0
    force_jitter_s: float = 0.0
    field_later_s: float = 0.0
    root_jerk: float = 3.0
    twist_jerk: float = 100.0
    bend_jerk: float = 100.0
    persistence_s: float = 0.3
    offset_persistence_s: float = 3.0
    anchor_sigma_mps2: float = 1.7
    anchor_low_hz: float = 0.5
    anchor_high_hz: float = 1.5

    @property
    def length_m(self) -> float:
        """From the anchor to the last node."""
        return self.pitch_m * (2 * self.node_count - 1)

    def to_c(self) -> Any:
        """A new struct ribbon_motion_params."""
        values = dataclasses.asdict(self)
        values["nodes"] = values.pop("node_count")
        values["field_ut"] = list(self.field_ut)
        values["field_normal"] = values.pop("field_normals") or [(0.0, 0.0, 1.0)] * min(
            self.node_count, NODE_MAX
        )
        return ffi.new("struct ribbon_motion_params *", values)


@dataclass(frozen=True, eq=False)
class Samples:
    """T scans of one ribbon, calibrated.

    t_s: (T,) seconds, increasing, on any clock. force_mps2, field_ut: (T, n, 3) node frame; values of
    sensors that are not valid are not read, and what a two-axis field has along its normal does not count.
    force_valid, field_valid: (T, n).
    level_q: (T, n, 4) level reading, world from node, scalar first, to start from and to fall back to;
    level_valid: (T, n). level_still: (T,) the device says that nothing moves.
    anchor_mps2: (T, 3) what is known of the anchor's acceleration, world.
    """

    t_s: Float64
    force_mps2: Float64
    field_ut: Float64
    force_valid: Bool
    field_valid: Bool
    level_q: Float64
    level_valid: Bool
    level_still: Bool
    anchor_mps2: Float64

    def __len__(self) -> int:
        return len(self.t_s)

    def __getitem__(self, part: slice) -> Self:
        return type(self)(**{f.name: getattr(self, f.name)[part] for f in dataclasses.fields(self)})

    def to_c(self, node_count: int, force_change_mps3: Float64) -> Any:
        """A new struct ribbon_motion_sample[T]; force_change_mps3: (T, n) see there.

        Raises ValueError naming an array of the wrong shape.
        """
        count, n = len(self.t_s), node_count
        shapes = {
            "t_s": (count,),
            "force_mps2": (count, n, 3),
            "field_ut": (count, n, 3),
            "force_valid": (count, n),
            "field_valid": (count, n),
            "level_q": (count, n, 4),
            "level_valid": (count, n),
            "level_still": (count,),
            "anchor_mps2": (count, 3),
        }
        samples = ffi.new("struct ribbon_motion_sample[]", max(count, 1))
        table = np.frombuffer(ffi.buffer(samples), _dtype("struct ribbon_motion_sample"), count)
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name))
            if value.shape != shape:
                raise ValueError(f"{name} has shape {value.shape}, not {shape}")
            table[name][tuple(slice(size) for size in shape)] = value
        table["force_change_mps3"][:, :n] = force_change_mps3
        return samples


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of all n nodes at T times; positions and their derivatives from the anchor, world directions.

    t_s: (T,). status: (T,) of Status; where it is WAITING all else is NaN.
    q_world_node: (T, n, 4) scalar first.
    position_m, velocity_mps, acceleration_mps2, rate_radps (angular velocity): (T, n, 3).
    sigma_rad: (T, n) standard deviation of the orientation, worst axis. position_covariance_m2: (T, n, 3, 3).
    anchor_acceleration_mps2: (T, 3).
    """

    t_s: Float64
    status: NDArray[np.int32]
    q_world_node: Float64
    position_m: Float64
    velocity_mps: Float64
    acceleration_mps2: Float64
    rate_radps: Float64
    sigma_rad: Float64
    position_covariance_m2: Float64
    anchor_acceleration_mps2: Float64

    @property
    def valid(self) -> Bool:
        """(T,) where there is an estimate."""
        return np.asarray(self.status != Status.WAITING)

    def radius_95_m(self) -> Float64:
        """(T, n) radius around each position that holds the true one with a probability of 95 %."""
        return radius_95_m(self.position_covariance_m2)


NODE_FIELDS = {
    "q": "q_world_node",
    "position_m": "position_m",
    "velocity_mps": "velocity_mps",
    "acceleration_mps2": "acceleration_mps2",
    "rate_radps": "rate_radps",
    "sigma_rad": "sigma_rad",
    "position_covariance_m2": "position_covariance_m2",
}


def radius_95_m(covariance_m2: Float64) -> Float64:
    """(...) radius around positions of covariance (..., 3, 3) that holds the true one with 95 %.

    The squared distance, a weighted sum of three chi-squared values, is taken as one of equal mean and
    variance (Satterthwaite), its quantile after Wilson and Hilferty. NaN where rounding has left no
    covariance, as can be of the first sample after a start in fast motion.
    """
    covariance = covariance_m2
    trace = np.trace(covariance, axis1=-2, axis2=-1)
    square = np.einsum("...ij,...ji->...", covariance, covariance)
    scale, freedom = square / trace, trace**2 / square
    spread = 2 / (9 * freedom)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(scale * freedom * (1 - spread + 1.6449 * np.sqrt(spread)) ** 3))


def motion_of(nodes: Any, count: int, status: NDArray[np.int32], t_s: Float64, node_count: int) -> Motion:
    """Motion from `count` struct ribbon_motion_nodes."""
    table = np.frombuffer(ffi.buffer(nodes), _dtype("struct ribbon_motion_nodes"), count)
    values = {name: table[field][:, :node_count].copy() for field, name in NODE_FIELDS.items()}
    values["anchor_acceleration_mps2"] = table["anchor_acceleration_mps2"].copy()
    waiting = status == Status.WAITING
    if waiting.any():
        for value in values.values():
            value[waiting] = np.nan
    return Motion(t_s=t_s.copy(), status=status.copy(), **values)


def join(parts: list[Motion]) -> Motion:
    """One motion after the other. `parts` must not be empty."""
    if len(parts) == 1:
        return parts[0]
    return Motion(
        **{
            f.name: np.concatenate([getattr(part, f.name) for part in parts])
            for f in dataclasses.fields(Motion)
        }
    )


@cache
def _dtype(structure: str) -> np.dtype[Any]:
    """The NumPy view of a C structure of doubles and bytes."""
    kinds = {"double": np.float64, "uint8_t": np.uint8}
    names, formats, offsets = [], [], []
    for name, field in ffi.typeof(structure).fields:
        shape: list[int] = []
        inner = field.type
        while inner.kind == "array":
            shape.append(inner.length)
            inner = inner.item
        names.append(name)
        formats.append((kinds[inner.cname], tuple(shape)))
        offsets.append(field.offset)
    return np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": ffi.sizeof(structure)}
    )
