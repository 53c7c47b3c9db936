"""Residuals and Jacobian of the straight bar: what all sensors read in poses that they share."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ribbonhost.calibrate.rotations import field_world_ut, rotation, skew
from ribbonhost.calibrate.sensor_errors import (
    STANDARD_GRAVITY_MPS2,
    Array,
    Parameters,
    Poses,
    Prior,
    Solution,
    matrix_basis,
)

SWING = 6  # unknowns of a pose: acceleration that is common, and that grows along the bar
TABLE = 2


@dataclass(frozen=True)
class State:
    """The unknowns, in units of the prior's standard deviations but for attitudes and dip.

    accel (A, 12): 9 matrix parameters, 3 biases. field (M, K + axes). swing (P, 6). table (2,): tilt of the
    table's normal toward east and north.
    """

    accel: Array
    field: Array
    r_world_bar: Array
    swing: Array
    table: Array
    dip_rad: float


class Problem:
    """Residuals and Jacobian of one set of poses; unknowns are scaled to unit prior variance."""

    def __init__(self, poses: Poses, prior: Prior, start: Parameters | None = None) -> None:
        """start: what the parameters scatter around; nominal sensors if none are given."""
        self.poses = poses
        self.prior = prior
        self.accel_basis, self.accel_names = matrix_basis(3)
        self.field_basis, self.field_names = matrix_basis(poses.axes)
        self.accel_sigma = self._sigmas(self.accel_names, prior.accel_scale, prior.accel_cross_axis)
        self.field_sigma = self._sigmas(self.field_names, prior.field_scale, prior.field_cross_axis)
        p, a, _ = poses.accel_mps2.shape
        m = poses.field_ut.shape[1]
        self.start = start or Parameters.nominal(a, m, poses.axes)
        self.n_poses, self.n_accel, self.n_field = p, a, m
        self.accel_width = len(self.accel_names) + 3
        self.field_width = len(self.field_names) + poses.axes
        self.n_sensor = a * self.accel_width + m * self.field_width
        self.first_swing = self.n_sensor + 3 * p
        self.first_table = self.first_swing + SWING * p
        self.n_unknown = self.first_table + TABLE + 1
        shape = np.ones(p)
        self.accel_noise = np.asarray(poses.accel_sigma_mps2 * shape)[:, None, None]
        self.field_noise = np.asarray(poses.field_sigma_ut * shape)[:, None, None]
        self.lying = np.linalg.norm(poses.up_face, axis=1) > 0.5
        # Two directions across each face, from world axes that are never along it.
        self.across = np.zeros((p, 2, 3))
        if self.lying.any():
            face = poses.up_face[self.lying]
            first = np.cross(face, np.roll(face, 1, axis=1))
            self.across[self.lying] = np.stack([first, np.cross(face, first)], axis=1)

    def _sigmas(self, names: tuple[str, ...], scale: float, cross: float) -> Array:
        kinds = {"scale": scale, "cross": cross, "mounting": self.prior.mounting_rad}
        return np.array([kinds[name.split("_")[0]] for name in names])

    def state(self, r_world_bar: Array, dip_rad: float, field_bias_ut: Array | None = None) -> State:
        """The starting parameters, with attitudes; field_bias_ut: (M, axes) instead of the start's."""
        field = np.zeros((self.n_field, self.field_width))
        if field_bias_ut is not None:
            deviation = field_bias_ut - self.start.field_bias_ut
            field[:, len(self.field_names) :] = deviation / self.prior.field_bias_ut
        accel = np.zeros((self.n_accel, self.accel_width))
        return State(accel, field, r_world_bar, np.zeros((self.n_poses, SWING)), np.zeros(TABLE), dip_rad)

    def state_of(self, solution: Solution, which: NDArray[np.bool_]) -> State:
        """The state that a solution of poses (P,) of which these are some has found."""
        values = (solution.values / self.scale())[:-1]
        split = self.n_accel * self.accel_width
        nothing = self.state(solution.r_world_bar[which], solution.parameters.dip_rad)
        return replace(
            nothing,
            accel=values[:split].reshape(nothing.accel.shape),
            field=values[split:].reshape(nothing.field.shape),
        )

    def moved(self, state: State, step: Array) -> State:
        """The state after a step in all unknowns."""
        split = self.n_accel * self.accel_width
        return State(
            state.accel + step[:split].reshape(state.accel.shape),
            state.field + step[split : self.n_sensor].reshape(state.field.shape),
            state.r_world_bar @ rotation(step[self.n_sensor : self.first_swing].reshape(-1, 3)),
            state.swing + step[self.first_swing : self.first_table].reshape(-1, SWING),
            state.table + step[self.first_table : -1],
            state.dip_rad + float(step[-1]) * self.prior.dip_rad,
        )

    def with_field_weights(self, weight: Array) -> Problem:
        """The same problem, with the field of each pose counting (P,) times as much."""
        other = copy(self)
        other.field_noise = self.field_noise / np.sqrt(weight)[:, None, None]
        return other

    def field_cost(self, state: State) -> Array:
        """(P, M) how badly each reading of the field is explained, mean square in standard deviations."""
        par = self.parameters(state)
        field = state.r_world_bar.swapaxes(1, 2) @ field_world_ut(self.poses.field_strength_ut, state.dip_rad)
        error = np.einsum("nij,pj->pni", par.field_matrix, field) + par.field_bias_ut - self.poses.field_ut
        return np.asarray(np.mean((error / self.field_noise) ** 2, axis=2))

    def parameters(self, state: State) -> Parameters:
        """The sensors of a state."""
        k, n, start = len(self.accel_names), len(self.field_names), self.start
        return Parameters(
            start.accel_matrix
            + np.einsum("ak,k,kij->aij", state.accel[:, :k], self.accel_sigma, self.accel_basis),
            start.accel_bias_mps2 + state.accel[:, k:] * self.prior.accel_bias_mps2,
            start.field_matrix
            + np.einsum("mk,k,kij->mij", state.field[:, :n], self.field_sigma, self.field_basis),
            start.field_bias_ut + state.field[:, n:] * self.prior.field_bias_ut,
            state.dip_rad,
        )

    def linearise(self, state: State) -> tuple[Array, sp.csr_array]:
        """Residuals (prediction minus reading, in standard deviations; sides on the table; the priors) and
        their Jacobian.
        """
        poses, par = self.poses, self.parameters(state)
        up = state.r_world_bar[:, 2, :] * STANDARD_GRAVITY_MPS2
        common = state.swing[:, :3] * poses.swing_mps2[:, None]
        growing = state.swing[:, 3:] * poses.swing_per_m[:, None]
        swing = common[:, None] + growing[:, None] * poses.accel_m[:, None]  # (P, A, 3)
        strength_ut = poses.field_strength_ut
        field = np.einsum("pji,j->pi", state.r_world_bar, field_world_ut(strength_ut, state.dip_rad))
        d_dip = field_world_ut(strength_ut, state.dip_rad + np.pi / 2) * self.prior.dip_rad
        field_by_dip = np.einsum("pji,j->pi", state.r_world_bar, d_dip)

        lever = np.concatenate(
            [
                poses.swing_mps2[:, None, None] * np.ones((1, self.n_accel, 1)),
                poses.swing_per_m[:, None, None] * poses.accel_m[None, :, None],
            ],
            axis=2,
        )
        accel_r, accel_j = self._sensor_block(
            up, swing, par.accel_matrix, par.accel_bias_mps2, poses.accel_mps2, self.accel_noise,
            self.accel_basis * self.accel_sigma[:, None, None], self.prior.accel_bias_mps2, 0,
            lever=lever,
        )  # fmt: skip
        field_r, field_j = self._sensor_block(
            field, 0.0, par.field_matrix, par.field_bias_ut, poses.field_ut, self.field_noise,
            self.field_basis * self.field_sigma[:, None, None], self.prior.field_bias_ut,
            self.n_accel * self.accel_width, by_dip=field_by_dip,
        )  # fmt: skip
        face_r, face_j = self._face_block(state)
        prior_r = np.concatenate([state.accel.ravel(), state.field.ravel(), state.swing.ravel(), state.table])
        columns = np.r_[0 : self.n_sensor, self.first_swing : self.n_unknown - 1]
        prior_j = sp.coo_array(
            (np.ones(len(columns)), (np.arange(len(columns)), columns)), (len(columns), self.n_unknown)
        )
        residual = np.concatenate([accel_r, field_r, face_r, prior_r])
        return residual, sp.csr_array(sp.vstack([accel_j, field_j, face_j, prior_j]))

    def _sensor_block(
        self, vectors: Array, swing: Array | float, matrix: Array, bias: Array, readings: Array, sigma: Array,
        basis: Array, bias_sigma: float, first_column: int, by_dip: Array | None = None,
        lever: Array | None = None,
    ) -> tuple[Array, sp.coo_array]:  # fmt: skip
        """Residuals and Jacobian of one kind of sensor: vectors (P, 3) in the bar frame, matrix (N, axes,
        3), sigma (P, 1, 1).
        """
        n_poses, n, axes = readings.shape
        felt = np.broadcast_to(vectors[:, None] + swing, (n_poses, n, 3))
        predicted = np.einsum("nij,pnj->pni", matrix, felt) + bias
        residual = (predicted - readings) / sigma
        over = sigma[..., None]
        by_matrix = np.einsum("kij,pnj->pnik", basis, felt) / over
        by_bias = np.broadcast_to(np.eye(axes) * bias_sigma, (n_poses, n, axes, axes)) / over
        own = np.concatenate([by_matrix, by_bias], axis=3)
        width = own.shape[3]
        # v = R^T w and R -> R exp([d]x) give dv = [v]x d.
        by_pose = np.einsum("nij,pjk->pnik", matrix, skew(vectors)) / over

        rows = np.arange(n_poses * n * axes).reshape(n_poses, n, axes)[..., None]
        poses = np.arange(n_poses)[:, None, None, None]
        own_columns = first_column + np.arange(n)[None, :, None, None] * width + np.arange(width)
        blocks = [
            (rows, own_columns, own),
            (rows, self.n_sensor + 3 * poses + np.arange(3), by_pose),
        ]
        if by_dip is not None:
            values = np.einsum("nij,pj->pni", matrix, by_dip)[..., None] / over
            blocks.append((rows, np.array(self.n_unknown - 1), values))
        if lever is not None:
            values = np.concatenate(
                [matrix[None] * lever[..., None, None, 0], matrix[None] * lever[..., None, None, 1]], axis=3
            )
            blocks.append((rows, self.first_swing + SWING * poses + np.arange(SWING), values / over))
        return residual.ravel(), _assembled(blocks, rows.size, self.n_unknown)

    def _face_block(self, state: State) -> tuple[Array, sp.coo_array]:
        """Two residuals a pose: the table's normal in the bar frame has no part across the bar's side."""
        tilt = np.array([*state.table, 0.0]) * self.prior.table_rad
        normal = np.array([0.0, 0.0, 1.0]) + tilt
        seen = np.einsum("pji,j->pi", state.r_world_bar, normal)
        across = self.across / self.prior.face_rad
        residual = np.einsum("pci,pi->pc", across, seen)
        by_pose = np.einsum("pci,pij->pcj", across, skew(seen))
        by_table = np.einsum("pci,pji->pcj", across, state.r_world_bar[:, :2]) * self.prior.table_rad
        rows = np.arange(residual.size).reshape(*residual.shape, 1)
        poses = np.arange(self.n_poses)[:, None, None]
        blocks = [
            (rows, self.n_sensor + 3 * poses + np.arange(3), by_pose),
            (rows, self.first_table + np.arange(TABLE), by_table),
        ]
        return residual.ravel(), _assembled(blocks, rows.size, self.n_unknown)

    def solution(self, state: State, residual: Array, jacobian: sp.csr_array) -> Solution:
        """The result at the minimum."""
        n_accel = self.n_poses * self.n_accel * 3
        n_data = n_accel + self.n_poses * self.n_field * self.poses.axes
        n_face = n_data + 2 * self.n_poses
        dof = max(n_data - self.n_sensor - 3 * self.n_poses - 1, 1)
        chi2_per_dof = float(residual[:n_data] @ residual[:n_data]) / dof
        # Readings that scatter by more than their noise make all that follows from them less certain.
        covariance = np.linalg.inv((jacobian.T @ jacobian).toarray()) * max(chi2_per_dof, 1.0)
        keep = np.r_[0 : self.n_sensor, self.n_unknown - 1]
        scale = self.scale()
        values = np.concatenate([state.accel.ravel(), state.field.ravel(), [0.0]]) * scale
        values[-1] = state.dip_rad
        return Solution(
            parameters=self.parameters(state),
            values=values,
            covariance=covariance[np.ix_(keep, keep)] * np.outer(scale, scale),
            names=self.names(),
            r_world_bar=state.r_world_bar,
            accel_residual=residual[:n_accel].reshape(self.n_poses, self.n_accel, 3),
            field_residual=residual[n_accel:n_data].reshape(self.n_poses, self.n_field, self.poses.axes),
            face_residual=residual[n_data:n_face].reshape(self.n_poses, 2),
            chi2_per_dof=chi2_per_dof,
        )

    def scale(self) -> Array:
        """Prior standard deviation of each unknown of `names`, in its own unit."""
        one_accel = np.r_[self.accel_sigma, np.full(3, self.prior.accel_bias_mps2)]
        one_field = np.r_[self.field_sigma, np.full(self.poses.axes, self.prior.field_bias_ut)]
        return np.asarray(
            np.r_[np.tile(one_accel, self.n_accel), np.tile(one_field, self.n_field), self.prior.dip_rad]
        )

    def names(self) -> tuple[str, ...]:
        """What the values of a solution are: `slot3.mounting_x` ..., the dip last."""
        letters = "xyz"
        accel = [*self.accel_names, *(f"bias_{c}_mps2" for c in letters)]
        field = [*self.field_names, *(f"bias_{c}_ut" for c in letters[: self.poses.axes])]
        return (
            *(f"slot{2 * i}.{name}" for i in range(self.n_accel) for name in accel),
            *(f"slot{2 * i + 1}.{name}" for i in range(self.n_field) for name in field),
            "dip_rad",
        )


def _assembled(blocks: list[tuple[Array, Array, Array]], rows: int, columns: int) -> sp.coo_array:
    """A sparse matrix of blocks of (rows, columns, values), each broadcast to one shape."""
    data, row, column = [], [], []
    for r, c, values in blocks:
        shape = np.broadcast_shapes(r.shape, c.shape, values.shape)
        row.append(np.broadcast_to(r, shape).ravel())
        column.append(np.broadcast_to(c, shape).ravel())
        data.append(np.broadcast_to(values, shape).ravel())
    return sp.coo_array(
        (np.concatenate(data), (np.concatenate(row), np.concatenate(column))), (rows, columns)
    )
