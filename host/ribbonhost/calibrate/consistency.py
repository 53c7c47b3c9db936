"""How well sensors agree in poses that they share, with parameters that are given."""

from __future__ import annotations

import numpy as np

from ribbonhost.calibrate.bar_start import tilts, with_headings
from ribbonhost.calibrate.rotations import field_world_ut, rotation, skew
from ribbonhost.calibrate.sensor_errors import (
    STANDARD_GRAVITY_MPS2,
    Array,
    Parameters,
    Poses,
    Solution,
    matrix_basis,
)
from ribbonhost.calibrate.straight_bar import calibrated

ITERATIONS = 12
ACCEL_SHARE, FIELD_SHARE = 0.003, 0.005
"""What the firmware takes calibration to leave of the errors: weighs gravity against field."""
ATTITUDES = 32


def disagreement_deg(poses: Poses, parameters: Parameters, field_strength_ut: float) -> float:
    """Root mean square, over poses and sensors, of the angle between what a sensor reads and what the
    attitude that fits all of them best says, degrees.

    field_strength_ut: |B| that the parameters are made for.
    """
    own = Poses(
        poses.accel_mps2, poses.field_ut, poses.accel_sigma_mps2, poses.field_sigma_ut, field_strength_ut
    )
    r, _ = with_headings(own, parameters, tilts(calibrated(own, parameters)))
    gravity = np.array([0.0, 0.0, STANDARD_GRAVITY_MPS2])
    field = field_world_ut(field_strength_ut, parameters.dip_rad)
    for _ in range(ITERATIONS):
        accel_r, accel_j = _aligned(
            r, gravity, parameters.accel_matrix, parameters.accel_bias_mps2, own.accel_mps2
        )
        field_r, field_j = _aligned(r, field, parameters.field_matrix, parameters.field_bias_ut, own.field_ut)
        residual = np.concatenate([accel_r / ACCEL_SHARE, field_r / FIELD_SHARE], axis=1)
        jacobian = np.concatenate([accel_j / ACCEL_SHARE, field_j / FIELD_SHARE], axis=1)
        normal = jacobian.swapaxes(1, 2) @ jacobian
        step = np.linalg.solve(normal, -(jacobian.swapaxes(1, 2) @ residual[..., None]))[..., 0]
        r = r @ rotation(step)
    return float(np.degrees(np.sqrt((np.mean(accel_r**2) + np.mean(field_r**2)) / 2 * 3)))


def _aligned(r: Array, world: Array, matrix: Array, bias: Array, readings: Array) -> tuple[Array, Array]:
    """Residuals (P, K) of readings (P, N, axes), shares of |world|, and Jacobian (P, K, 3) by attitude."""
    size = float(np.linalg.norm(world))
    seen = np.einsum("pji,j->pi", r, world)
    residual = (np.einsum("nij,pj->pni", matrix, seen) + bias - readings) / size
    jacobian = np.einsum("nij,pjk->pnik", matrix, skew(seen)) / size
    return residual.reshape(len(r), -1), jacobian.reshape(len(r), -1, 3)


def orientation_sigma_deg(solution: Solution, field_strength_ut: float) -> Array:
    """(M,) what the uncertainty of the parameters leaves of orientations at each magnetometer, degrees: root
    mean square over attitudes, worst axis.

    An orientation is that which fits the accelerometers on both sides and the magnetometer best, to first
    order (the normal equations of `disagreement_deg`, of these sensors alone).
    """
    par, covariance = solution.parameters, solution.covariance
    accels, mags = len(par.accel_matrix), len(par.field_matrix)
    axes = par.field_matrix.shape[1]
    first_field = accels * 12
    width = (covariance.shape[0] - 1 - first_field) // mags
    attitudes = _spread_attitudes(ATTITUDES)
    gravity = np.array([0.0, 0.0, STANDARD_GRAVITY_MPS2])
    field = field_world_ut(field_strength_ut, par.dip_rad)
    by_dip = field_world_ut(1.0, par.dip_rad + np.pi / 2)
    basis_a, basis_m = matrix_basis(3)[0], matrix_basis(axes)[0]
    sigmas = np.zeros(mags)
    for k in range(mags):
        near = [k, min(k + 1, accels - 1)]
        columns = np.r_[
            12 * near[0] : 12 * near[0] + 12,
            12 * near[1] : 12 * near[1] + 12,
            first_field + width * k : first_field + width * (k + 1),
            covariance.shape[0] - 1,
        ]
        local = covariance[np.ix_(columns, columns)]
        worst = []
        for r in attitudes:
            g, b, db = r.T @ gravity / STANDARD_GRAVITY_MPS2, r.T @ field / field_strength_ut, r.T @ by_dip
            jacobian, by_parameter = np.zeros((6 + axes, 3)), np.zeros((6 + axes, len(columns)))
            for row in (0, 1):
                rows = slice(3 * row, 3 * row + 3)
                jacobian[rows] = skew(g) / ACCEL_SHARE
                by_parameter[rows, 12 * row : 12 * row + 9] = (basis_a @ g).T / ACCEL_SHARE
                by_parameter[rows, 12 * row + 9 : 12 * row + 12] = (
                    np.eye(3) / STANDARD_GRAVITY_MPS2 / ACCEL_SHARE
                )
            jacobian[6:] = skew(b)[:axes] / FIELD_SHARE
            of_field = np.concatenate(
                [(basis_m @ b).T, np.eye(axes) / field_strength_ut, db[:axes, None]], axis=1
            )
            by_parameter[6:, 24:] = of_field / FIELD_SHARE
            gain = np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ by_parameter)
            worst.append(np.linalg.eigvalsh(gain @ local @ gain.T)[-1])
        sigmas[k] = np.degrees(np.sqrt(np.mean(worst)))
    return sigmas


def _spread_attitudes(count: int) -> Array:
    """Rotations that are spread evenly: the super-Fibonacci spiral (Alexa, CVPR 2022)."""
    i = np.arange(count) + 0.5
    radius, other = np.sqrt(i / count), np.sqrt(1 - i / count)
    a, b = 2 * np.pi * i / np.sqrt(2), 2 * np.pi * i / 1.533751168755204288118041413
    x, y, z, w = radius * np.sin(a), radius * np.cos(a), other * np.sin(b), other * np.cos(b)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )
