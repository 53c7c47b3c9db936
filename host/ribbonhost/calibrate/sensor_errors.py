"""Errors of the sensors of a ribbon as parameters, and the poses that tell them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STANDARD_GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True)
class Prior:
    """How far parts off the shelf scatter (one standard deviation), from data sheets and assembly
    tolerances."""

    accel_bias_mps2: float = 0.4
    accel_scale: float = 0.02
    accel_cross_axis: float = 0.01
    field_bias_ut: float = 30.0
    field_scale: float = 0.06
    field_cross_axis: float = 0.03
    mounting_rad: float = 0.0175
    dip_rad: float = 0.5


@dataclass(frozen=True)
class Poses:
    """Mean readings of a ribbon in P still poses, in SI units of the uncalibrated parts.

    accel_mps2: (P, A, 3). field_ut: (P, M, axes), axes 2 or 3. accel_sigma_mps2, field_sigma_ut: standard
    deviation of one mean reading, same for all. field_strength_ut: |B| at the place; only its ratio to the
    truth is unobservable.
    """

    accel_mps2: Array
    field_ut: Array
    accel_sigma_mps2: float
    field_sigma_ut: float
    field_strength_ut: float

    @property
    def axes(self) -> int:
        return int(self.field_ut.shape[2])


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


@dataclass(frozen=True)
class Solution:
    """What the poses tell: parameters with their covariance, attitudes and residuals.

    values (K,): the parameters as deviations from nominal, in the order of `names`; covariance (K, K).
    attitudes r_world_bar (P, 3, 3). Residuals are readings minus prediction, in standard deviations:
    accel_residual (P, A, 3), field_residual (P, M, axes). chi2_per_dof: their mean square over the degrees
    of freedom.
    """

    parameters: Parameters
    values: Array
    covariance: Array
    names: tuple[str, ...]
    r_world_bar: Array
    accel_residual: Array
    field_residual: Array
    chi2_per_dof: float


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
