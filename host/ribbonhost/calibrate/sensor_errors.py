"""Errors of the sensors of a ribbon as parameters, and the poses that tell them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STANDARD_GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True)
class Prior:
    """How far parameters scatter around where the search starts (one standard deviation); the defaults are
    parts off the shelf, from data sheets and assembly tolerances.

    face_rad: between a side of the bar and the plane that it lies on. table_rad: between that plane and the
    level. dip_rad only scales its unknown.
    """

    accel_bias_mps2: float = 0.4
    accel_scale: float = 0.02
    accel_cross_axis: float = 0.01
    field_bias_ut: float = 30.0
    field_scale: float = 0.06
    field_cross_axis: float = 0.03
    mounting_rad: float = 0.0175
    dip_rad: float = 0.5
    face_rad: float = 0.0012
    table_rad: float = 0.035


@dataclass(frozen=True)
class Poses:
    """Mean readings of a ribbon in P still poses, in SI units of the uncalibrated parts.

    accel_mps2: (P, A, 3). field_ut: (P, M, axes), axes 2 or 3. accel_sigma_mps2, field_sigma_ut: standard
    deviation of one mean reading, one for all or (P,). field_strength_ut: |B| at the place; only its ratio to
    the truth is unobservable.
    up_face: (P, 3) the axis of the node frame that is normal to the table on which the bar lies; zero where
    it is held. swing_mps2, swing_per_m: (P,) standard deviation of what is left of the hand's acceleration,
    common to all, and growing along the bar (m/s^2 a metre). accel_m: (A,) places of the accelerometers along
    the bar, from its middle.
    """

    accel_mps2: Array
    field_ut: Array
    accel_sigma_mps2: float | Array
    field_sigma_ut: float | Array
    field_strength_ut: float
    up_face: Array = field(default_factory=lambda: np.zeros((0, 3)))
    swing_mps2: Array = field(default_factory=lambda: np.zeros(0))
    swing_per_m: Array = field(default_factory=lambda: np.zeros(0))
    accel_m: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        count, accels = self.accel_mps2.shape[:2]
        for name, shape in (
            ("up_face", (count, 3)),
            ("swing_mps2", (count,)),
            ("swing_per_m", (count,)),
            ("accel_m", (accels,)),
        ):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.zeros(shape))

    @property
    def axes(self) -> int:
        """Axes of the magnetometers."""
        return int(self.field_ut.shape[2])

    def __len__(self) -> int:
        return len(self.accel_mps2)

    def part(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Poses:
        """Some of the poses."""
        count = len(self)

        def of(sigma: float | Array) -> Array:
            return np.broadcast_to(np.asarray(sigma, dtype=np.float64), (count,))[which]

        return Poses(
            self.accel_mps2[which],
            self.field_ut[which],
            of(self.accel_sigma_mps2),
            of(self.field_sigma_ut),
            self.field_strength_ut,
            self.up_face[which],
            self.swing_mps2[which],
            self.swing_per_m[which],
            self.accel_m,
        )


@dataclass(frozen=True)
class Parameters:
    """Sensing matrices and biases: reading = matrix @ (vector in the node frame) + bias.

    accel_matrix (A, 3, 3), accel_bias_mps2 (A, 3), field_matrix (M, axes, 3), field_bias_ut (M, axes),
    dip_rad.
    """

    accel_matrix: Array
    accel_bias_mps2: Array
    field_matrix: Array
    field_bias_ut: Array
    dip_rad: float

    @classmethod
    def nominal(cls, accels: int, mags: int, axes: int) -> Parameters:
        """Sensors without errors; the dip is only where a search may start."""
        return cls(
            np.tile(np.eye(3), (accels, 1, 1)),
            np.zeros((accels, 3)),
            np.tile(np.eye(3)[:axes], (mags, 1, 1)),
            np.zeros((mags, axes)),
            0.0,
        )


@dataclass(frozen=True)
class Solution:
    """What the poses tell: parameters with their covariance, attitudes and residuals.

    values (K,): the parameters as deviations from where the search started, in the order of `names`;
    covariance (K, K).
    attitudes r_world_bar (P, 3, 3). Residuals are prediction minus reading, in standard deviations:
    accel_residual (P, A, 3), field_residual (P, M, axes), face_residual (P, 2), zero for a bar that is held.
    chi2_per_dof: their mean square over the degrees of freedom.
    """

    parameters: Parameters
    values: Array
    covariance: Array
    names: tuple[str, ...]
    r_world_bar: Array
    accel_residual: Array
    field_residual: Array
    face_residual: Array
    chi2_per_dof: float

    @property
    def sigma(self) -> Array:
        """(K,) standard deviations of the values."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def matrix_basis(axes: int) -> tuple[Array, tuple[str, ...]]:
    """Deviations of a sensing matrix from nominal as physical parameters.

    Returns basis (K, axes, 3) and the names: scale, cross-axis (symmetric) and mounting (rotation vector of
    the part in the node frame). With two axes the parts of cross-axis that tilt a sensing axis out of the
    plane are mounting.
    """
    entries: list[Array] = []
    names: list[str] = []
    letters = "xyz"
    for i in range(axes):
        e = np.zeros((3, 3))
        e[i, i] = 1.0
        entries.append(e)
        names.append(f"scale_{letters[i]}")
    for i in range(axes):
        for j in range(i + 1, axes):
            e = np.zeros((3, 3))
            e[i, j] = e[j, i] = 1.0
            entries.append(e)
            names.append(f"cross_axis_{letters[i]}{letters[j]}")
    for i in range(3):
        # A part turned by the rotation vector w reads (I - [w]x) v.
        e = np.zeros((3, 3))
        j, k = (i + 1) % 3, (i + 2) % 3
        e[j, k], e[k, j] = 1.0, -1.0
        entries.append(e)
        names.append(f"mounting_{letters[i]}")
    return np.array(entries)[:, :axes, :], tuple(names)
