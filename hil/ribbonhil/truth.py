"""What is true of an emulated comb: where every sensor is at any time, and what it feels.

World frame east, north, up; node frame tangent, binormal, normal (docs/architecture.md).
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike
from ribbonhost.errors import UsageError

from ribbonhil.geodesics import Geodesics, trace
from ribbonhil.scenes import Array, Scene, SceneError

GRAVITY_MPS2 = 9.80665
PITCH_M = 0.025
SLOT_COUNT = 32
SPACING_SLOTS = 6  # of the reference, between neighbouring ribbons
RIBBONS_MAX = (SLOT_COUNT - 1) // SPACING_SLOTS + 1

_INSTANTS_MIN = 64
_INSTANTS_MAX = 1024
_RESOLVED_M = 1e-5  # largest harmonic in the upper quarter of the spectrum at which sampling is fine enough
_OVERSAMPLING = 2
_ROWS_MIN = 256


@dataclass(frozen=True)
class Field:
    """The earth's magnetic field; dip is positive downward, north is the y axis."""

    dip_deg: float = 62.0
    strength_ut: float = 48.0

    def world_ut(self) -> Array:
        """(3,) vector in the world."""
        dip_rad = math.radians(self.dip_deg)
        return self.strength_ut * np.array([0.0, math.cos(dip_rad), -math.sin(dip_rad)])


@dataclass(frozen=True, eq=False)
class RibbonTruth:
    """What the S sensors of one ribbon feel at K equal steps of time, node frame.

    specific_force_mps2, field_ut: (K, S, 3), C-contiguous float64.
    periodic: after the last row comes the first; otherwise the first and the last row hold.
    """

    specific_force_mps2: Array
    field_ut: Array
    step_s: float
    periodic: bool = True


@dataclass(frozen=True, eq=False)
class CombTruth:
    """One period of a comb's motion in equal steps: K rows, R + 1 ribbons (0 is the reference), S slots.

    period_s: row k is at true times (k / K + whole number) * period_s.
    start_m: R arc lengths on the reference at which the ribbons start.
    position_m: (K, R + 1, S, 3) in the world.
    r_world_node: (K, R + 1, S, 3, 3) rotation matrices, their columns are tangent, binormal, normal.
    specific_force_mps2, field_ut: (K, R + 1, S, 3) in the node frame: what ideal sensors read.
    """

    period_s: float
    pitch_m: float
    start_m: tuple[float, ...]
    position_m: Array
    r_world_node: Array
    specific_force_mps2: Array
    field_ut: Array

    def ribbon(self, index: int) -> RibbonTruth:
        """What the sensors of ribbon `index` feel; 0 is the reference."""
        return RibbonTruth(
            np.ascontiguousarray(self.specific_force_mps2[:, index]),
            np.ascontiguousarray(self.field_ut[:, index]),
            self.period_s / len(self.position_m),
        )

    def slot_m(self, t_s: ArrayLike) -> Array:
        """True positions of all slots, (..., R + 1, S, 3) in the world for times (...)."""
        return interpolate(self.position_m, np.asarray(t_s, dtype=np.float64) / self.period_s)

    def node_m(self, t_s: ArrayLike) -> Array:
        """True positions of all nodes, (..., R + 1, S / 2, 3) in the world for times (...)."""
        return interpolate(self.position_m[:, :, 1::2], np.asarray(t_s, dtype=np.float64) / self.period_s)

    @cached_property
    def _node_from_anchor_m(self) -> Array:
        return np.ascontiguousarray(self.position_m[:, :, 1::2] - self.position_m[:, :1, :1])

    def node_from_anchor_m(self, t_s: ArrayLike) -> Array:
        """The same, measured from the reference's anchor, which is where a reconstruction starts."""
        return interpolate(self._node_from_anchor_m, np.asarray(t_s, dtype=np.float64) / self.period_s)

    def q_world_slot(self, t_s: ArrayLike) -> Array:
        """True orientations of all slots, quaternions (..., R + 1, S, 4), scalar first, w >= 0."""
        phase = np.asarray(t_s, dtype=np.float64) / self.period_s
        return quaternions(orthonormal(interpolate(self.r_world_node, phase)))


@lru_cache(maxsize=4)
def comb_truth(scene: Scene, ribbons: int, field: Field = Field()) -> CombTruth:
    """The truth of a comb of 1 to RIBBONS_MAX ribbons on a scene.

    The reference ribbon is the geodesic from the origin toward east; ribbon j starts at its slot
    SPACING_SLOTS * j, orthogonal to it, toward north.

    Raises SceneError if the ribbons cannot be traced or the motion is too abrupt, UsageError for a number of
    ribbons that the reference has no room for.
    """
    start_m = starts_m(ribbons)
    sampled = _sampled_period(scene, ribbons)
    rows = max(_ROWS_MIN, _OVERSAMPLING * len(sampled.position_m))
    position_m = resample(sampled.position_m, rows)
    acceleration_mps2 = resample(sampled.position_m, rows, derivative=2) / scene.period_s**2
    r_world_node = orthonormal(
        np.stack([resample(v, rows) for v in (sampled.tangent, sampled.binormal, sampled.normal)], axis=-1)
    )
    pull_mps2 = acceleration_mps2 + np.array([0.0, 0.0, GRAVITY_MPS2])
    return CombTruth(
        period_s=scene.period_s,
        pitch_m=PITCH_M,
        start_m=start_m,
        position_m=position_m,
        r_world_node=r_world_node,
        specific_force_mps2=np.einsum("...ij,...i->...j", r_world_node, pull_mps2),
        field_ut=np.einsum("...ij,i->...j", r_world_node, field.world_ut()),
    )


def starts_m(ribbons: int) -> tuple[float, ...]:
    """Where the ribbons start on the reference. Raises UsageError for a number that it has no room for."""
    if not 1 <= ribbons <= RIBBONS_MAX:
        raise UsageError(f"an emulated comb has 1 to {RIBBONS_MAX} ribbons on its reference, not {ribbons}")
    return tuple(round(j * SPACING_SLOTS * PITCH_M, 9) for j in range(ribbons))


def trace_comb(scene: Scene, ribbons: int, t: Array) -> Geodesics:
    """All ribbons of a comb at instants t (M, periods): arrays (M, ribbons + 1, SLOT_COUNT, 3)."""
    origin = np.zeros((len(t), 1, 2))
    east = np.broadcast_to([1.0, 0.0, 0.0], (len(t), 1, 3))
    reference = trace(scene, t[:, None], origin, east, PITCH_M, SLOT_COUNT)
    roots = slice(0, SPACING_SLOTS * ribbons, SPACING_SLOTS)
    others = trace(
        scene,
        np.repeat(t[:, None], ribbons, axis=1),
        reference.position_m[:, 0, roots, :2],
        reference.binormal[:, 0, roots],
        PITCH_M,
        SLOT_COUNT,
    )
    return Geodesics(
        *(
            np.concatenate([getattr(reference, name), getattr(others, name)], axis=1)
            for name in ("position_m", "tangent", "binormal", "normal")
        )
    )


def _sampled_period(scene: Scene, ribbons: int) -> Geodesics:
    """The comb at M equal steps of a period, M a power of two large enough for the motion's harmonics."""
    sampled = trace_comb(scene, ribbons, np.arange(_INSTANTS_MIN) / _INSTANTS_MIN)
    while _highest_harmonics_m(sampled.position_m) > _RESOLVED_M:
        count = len(sampled.position_m)
        if count >= _INSTANTS_MAX:
            raise SceneError(
                f"ribbons on {scene.name} jump: its height must bend less or change more smoothly"
            )
        between = trace_comb(scene, ribbons, (np.arange(count) + 0.5) / count)
        sampled = Geodesics(
            *(
                np.stack([getattr(sampled, name), getattr(between, name)], axis=1).reshape(
                    2 * count, *sampled.position_m.shape[1:]
                )
                for name in ("position_m", "tangent", "binormal", "normal")
            )
        )
    return sampled


def _highest_harmonics_m(position_m: Array) -> float:
    spectrum = np.fft.rfft(position_m, axis=0) / len(position_m)
    return float(np.abs(spectrum[len(spectrum) * 3 // 4 :]).max())


def resample(samples: Array, rows: int, derivative: int = 0) -> Array:
    """A periodic signal, (M, ...) equal steps of a period, at `rows` >= M equal steps: Fourier interpolation.

    derivative: how often to differentiate with respect to the period.
    """
    count = len(samples)
    spectrum = np.fft.rfft(samples, axis=0) * (rows / count)
    harmonics = np.arange(len(spectrum))
    factor = (2j * np.pi * harmonics) ** derivative
    if count % 2 == 0 and (rows > count or derivative % 2):
        # The harmonic at half the sampling rate stands for two of opposite sign.
        factor[-1] = factor[-1].real / 2 if derivative % 2 == 0 else 0.0
    spectrum *= factor.reshape((-1,) + (1,) * (samples.ndim - 1))
    return np.asarray(np.fft.irfft(spectrum, rows, axis=0), dtype=np.float64)


def interpolate(table: Array, phase: Array) -> Array:
    """A periodic table (K, ...) at phases (any shape, periods): cubic through the four nearest rows."""
    place = phase * len(table)
    below = np.floor(place)
    u = place - below
    rows = (below[..., None].astype(np.int64) + np.array([-1, 0, 1, 2])) % len(table)
    weights = np.stack(
        [
            -u * (u - 1) * (u - 2) / 6,
            (u + 1) * (u - 1) * (u - 2) / 2,
            -(u + 1) * u * (u - 2) / 2,
            (u + 1) * u * (u - 1) / 6,
        ],
        axis=-1,
    )
    value: Array = np.einsum("...k,...kv->...v", weights, table[rows].reshape(*rows.shape, -1))
    return value.reshape(*phase.shape, *table.shape[1:])


def orthonormal(matrices: Array) -> Array:
    """Rotation matrices (..., 3, 3) from nearly orthonormal ones: the first column keeps its direction."""
    first = matrices[..., 0]
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    third = np.cross(first, matrices[..., 1])
    third = third / np.linalg.norm(third, axis=-1, keepdims=True)
    return np.stack([first, np.cross(third, first), third], axis=-1)


def quaternions(r: Array) -> Array:
    """Unit quaternions (..., 4), scalar first, w >= 0, of rotation matrices (..., 3, 3).

    Each row of 4 q q^T gives q; the one with the largest diagonal element is the best conditioned.
    """
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    outer = np.stack(
        [
            np.stack([1 + xx + yy + zz, wx, wy, wz], axis=-1),
            np.stack([wx, 1 + xx - yy - zz, xy, xz], axis=-1),
            np.stack([wy, xy, 1 - xx + yy - zz, yz], axis=-1),
            np.stack([wz, xz, yz, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(outer, best[..., None, None], axis=-2)[..., 0, :]
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)
