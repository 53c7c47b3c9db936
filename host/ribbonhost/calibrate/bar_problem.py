"""Residuals and Jacobian of the straight bar: what all sensors read in poses that they share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ribbonhost.calibrate.sensor_errors import (
    STANDARD_GRAVITY_MPS2,
    Array,
    Parameters,
    Poses,
    Prior,
    Solution,
    matrix_basis,
)


@dataclass(frozen=True)
class State:
    accel: Array  # (A, 12) in units of the prior's standard deviations: 9 matrix parameters, 3 biases
    field: Array  # (M, K + axes)
    r_world_bar: Array  # (P, 3, 3)
    dip_rad: float


def _skew(v: Array) -> Array:
    """[v]x of vectors (..., 3) as matrices (..., 3, 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def _exp(w: Array) -> Array:
    """Rotation matrices (P, 3, 3) of rotation vectors (P, 3) (Rodrigues)."""
    angle = np.linalg.norm(w, axis=-1)[:, None, None]
    k = _skew(w)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0, np.sin(safe) / safe)
    b = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    return np.eye(3) + a * k + b * (k @ k)


class Problem:
    """Residuals and Jacobian of one set of poses; unknowns are scaled to unit prior variance."""

    def __init__(self, poses: Poses, prior: Prior) -> None:
        self.poses = poses
        self.prior = prior
        self.accel_basis, self.accel_names = matrix_basis(3)
        self.field_basis, self.field_names = matrix_basis(poses.axes)
        self.accel_sigma = self._sigmas(self.accel_names, prior.accel_scale, prior.accel_cross_axis)
        self.field_sigma = self._sigmas(self.field_names, prior.field_scale, prior.field_cross_axis)
        p, a, _ = poses.accel_mps2.shape
        m = poses.field_ut.shape[1]
        self.n_poses, self.n_accel, self.n_field = p, a, m
        self.accel_width = len(self.accel_names) + 3
        self.field_width = len(self.field_names) + poses.axes
        self.n_sensor = a * self.accel_width + m * self.field_width
        self.n_unknown = self.n_sensor + 3 * p + 1

    def _sigmas(self, names: tuple[str, ...], scale: float, cross: float) -> Array:
        kinds = {"scale": scale, "cross": cross, "mounting": self.prior.mounting_rad}
        return np.array([kinds[name.split("_")[0]] for name in names])

    def initial_states(self) -> list[State]:
        """Starting points: nominal sensors, tilt from the mean of all accelerometers, headings by search.

        The hard iron common to all magnetometers is searched on a grid, and for each value the heading of
        each pose: with it wrong the alternation of the two stops in side minima. The best few are worth a
        descent each.
        """
        poses, axes = self.poses, self.poses.axes
        up = poses.accel_mps2.mean(axis=1)
        up /= np.linalg.norm(up, axis=1)[:, None]
        tilt = np.array([_any_rotation_with_up(u) for u in up])
        mean_field = poses.field_ut.mean(axis=1)
        turns = np.linspace(0, 2 * np.pi, 72, endpoint=False)
        headings = _exp(np.stack([np.zeros_like(turns), np.zeros_like(turns), turns], axis=1))
        attitudes = np.einsum("tij,pjk->ptik", headings, tilt)

        centre = mean_field.mean(axis=0)
        # A step that is a fraction of the field finds the basin; two finer grids go down in it.
        steps = {2: 13, 3: 7}[axes]
        radius_ut = poses.field_strength_ut
        radii_ut = (radius_ut, radius_ut * 2 / steps, radius_ut * 4 / steps**2)
        starts: list[tuple[float, Array, Array, float]] = []
        for dip in np.radians([-70.0, -45.0, -15.0, 15.0, 45.0, 60.0, 70.0]):
            field = np.einsum("ptji,j->pti", attitudes, self._field_world(dip))[..., :axes]
            offset, cost = centre[None], np.zeros(1)
            for radius in radii_ut:
                line = np.linspace(-radius, radius, steps)
                box = np.stack(np.meshgrid(*[line] * axes, indexing="ij"), axis=-1).reshape(-1, axes)
                offset = offset[np.argmin(cost)] + box
                cost = np.zeros(len(offset))
                for p in range(self.n_poses):
                    error = mean_field[p] - offset[:, None] - field[p]
                    cost += np.einsum("oti,oti->ot", error, error).min(axis=1)
            best = offset[np.argmin(cost)]
            heading = np.argmin(np.sum((mean_field[:, None] - best - field) ** 2, axis=2), axis=1)
            starts.append((float(cost.min()), best, heading, float(dip)))
        starts.sort(key=lambda start: start[0])
        states = []
        for _, _, heading, dip in starts[:3]:
            accel = np.zeros((self.n_accel, self.accel_width))
            mags = np.zeros((self.n_field, self.field_width))
            r = attitudes[np.arange(self.n_poses), heading]
            seen = np.einsum("pji,j->pi", r, self._field_world(dip))[:, :axes]
            bias = np.mean(poses.field_ut - seen[:, None], axis=0)
            mags[:, len(self.field_names) :] = bias / self.prior.field_bias_ut
            states.append(State(accel, mags, r, dip))
        return states

    def best_headings(self, state: State) -> State | None:
        """The state with each pose turned about the vertical to where all magnetometers fit best; None if
        none turns.
        """
        par = self.parameters(state)
        turns = np.linspace(0, 2 * np.pi, 180, endpoint=False)
        about_up = _exp(np.stack([np.zeros_like(turns), np.zeros_like(turns), turns], axis=1))
        candidates = np.einsum("tij,pjk->ptik", about_up, state.r_world_bar)
        field = np.einsum("ptji,j->pti", candidates, self._field_world(state.dip_rad))
        predicted = np.einsum("nij,ptj->ptni", par.field_matrix, field) + par.field_bias_ut
        cost = np.sum((predicted - self.poses.field_ut[:, None]) ** 2, axis=(2, 3))
        best = np.argmin(cost, axis=1)
        far = (best > 2) & (best < len(turns) - 2)
        if not far.any():
            return None
        r = np.where(far[:, None, None], candidates[np.arange(self.n_poses), best], state.r_world_bar)
        return State(state.accel, state.field, r, state.dip_rad)

    def _field_world(self, dip_rad: float) -> Array:
        return self.poses.field_strength_ut * np.array([0.0, np.cos(dip_rad), -np.sin(dip_rad)])

    def moved(self, state: State, step: Array) -> State:
        split = self.n_accel * self.accel_width
        return State(
            state.accel + step[:split].reshape(state.accel.shape),
            state.field + step[split : self.n_sensor].reshape(state.field.shape),
            state.r_world_bar @ _exp(step[self.n_sensor : -1].reshape(-1, 3)),
            state.dip_rad + float(step[-1]) * self.prior.dip_rad,
        )

    def parameters(self, state: State) -> Parameters:
        k, n = len(self.accel_names), len(self.field_names)
        return Parameters(
            np.eye(3) + np.einsum("ak,k,kij->aij", state.accel[:, :k], self.accel_sigma, self.accel_basis),
            state.accel[:, k:] * self.prior.accel_bias_mps2,
            np.eye(3)[: self.poses.axes]
            + np.einsum("mk,k,kij->mij", state.field[:, :n], self.field_sigma, self.field_basis),
            state.field[:, n:] * self.prior.field_bias_ut,
            state.dip_rad,
        )

    def linearise(self, state: State) -> tuple[Array, sp.csr_array]:
        """Residuals (prediction minus reading, in standard deviations, then the priors) and their
        Jacobian.
        """
        poses, par = self.poses, self.parameters(state)
        up = state.r_world_bar[:, 2, :] * STANDARD_GRAVITY_MPS2
        field_world = self._field_world(state.dip_rad)
        field = np.einsum("pji,j->pi", state.r_world_bar, field_world)
        d_dip = poses.field_strength_ut * np.array([0.0, -np.sin(state.dip_rad), -np.cos(state.dip_rad)])
        field_by_dip = np.einsum("pji,j->pi", state.r_world_bar, d_dip) * self.prior.dip_rad

        accel_r, accel_j = self._sensor_block(
            up, par.accel_matrix, par.accel_bias_mps2, poses.accel_mps2, poses.accel_sigma_mps2,
            self.accel_basis * self.accel_sigma[:, None, None], self.prior.accel_bias_mps2, 0, None,
        )  # fmt: skip
        field_r, field_j = self._sensor_block(
            field, par.field_matrix, par.field_bias_ut, poses.field_ut, poses.field_sigma_ut,
            self.field_basis * self.field_sigma[:, None, None], self.prior.field_bias_ut,
            self.n_accel * self.accel_width, field_by_dip,
        )  # fmt: skip
        prior_r = np.concatenate([state.accel.ravel(), state.field.ravel()])
        prior_j = sp.eye_array(self.n_sensor, self.n_unknown)
        residual = np.concatenate([accel_r, field_r, prior_r])
        return residual, sp.csr_array(sp.vstack([accel_j, field_j, prior_j]))

    def _sensor_block(
        self, vectors: Array, matrix: Array, bias: Array, readings: Array, sigma: float,
        basis: Array, bias_sigma: float, first_column: int, vectors_by_dip: Array | None,
    ) -> tuple[Array, sp.coo_array]:  # fmt: skip
        """Residuals and Jacobian of one kind of sensor: vectors (P, 3) in the bar frame, matrix (N, axes,
        3).
        """
        n_poses, n, axes = readings.shape
        predicted = np.einsum("nij,pj->pni", matrix, vectors) + bias
        residual = (predicted - readings) / sigma
        by_matrix = np.einsum("kij,pj->pik", basis, vectors) / sigma  # (P, axes, K), the same for all sensors
        by_bias = np.eye(axes) * (bias_sigma / sigma)
        own = np.concatenate([by_matrix, np.broadcast_to(by_bias, (n_poses, axes, axes))], axis=2)
        width = own.shape[2]
        # v = R^T w and R -> R exp([d]x) give dv = [v]x d.
        by_pose = np.einsum("nij,pjk->pnik", matrix, _skew(vectors)) / sigma

        rows = np.arange(n_poses * n * axes).reshape(n_poses, n, axes)
        own_columns = first_column + np.arange(n)[None, :, None, None] * width + np.arange(width)
        pose_columns = self.n_sensor + 3 * np.arange(n_poses)[:, None, None, None] + np.arange(3)
        blocks = [
            (rows[..., None], own_columns, own[:, None]),
            (rows[..., None], pose_columns, by_pose),
        ]
        if vectors_by_dip is not None:
            by_dip = np.einsum("nij,pj->pni", matrix, vectors_by_dip)[..., None] / sigma
            blocks.append((rows[..., None], np.array(self.n_unknown - 1), by_dip))
        data, row, column = [], [], []
        for r, c, values in blocks:
            shape = np.broadcast_shapes(r.shape, c.shape, values.shape)
            row.append(np.broadcast_to(r, shape).ravel())
            column.append(np.broadcast_to(c, shape).ravel())
            data.append(np.broadcast_to(values, shape).ravel())
        jacobian = sp.coo_array(
            (np.concatenate(data), (np.concatenate(row), np.concatenate(column))), (rows.size, self.n_unknown)
        )
        return residual.ravel(), jacobian

    def solution(self, state: State, residual: Array, jacobian: sp.csr_array) -> Solution:
        n_accel = self.n_poses * self.n_accel * 3
        n_data = n_accel + self.n_poses * self.n_field * self.poses.axes
        dof = max(n_data - self.n_sensor - 3 * self.n_poses - 1, 1)
        chi2_per_dof = float(residual[:n_data] @ residual[:n_data]) / dof
        covariance = np.linalg.inv((jacobian.T @ jacobian).toarray())
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
        letters = "xyz"
        accel = [*self.accel_names, *(f"bias_{c}_mps2" for c in letters)]
        field = [*self.field_names, *(f"bias_{c}_ut" for c in letters[: self.poses.axes])]
        return (
            *(f"slot{2 * i}.{name}" for i in range(self.n_accel) for name in accel),
            *(f"slot{2 * i + 1}.{name}" for i in range(self.n_field) for name in field),
            "dip_rad",
        )


def _any_rotation_with_up(up: Array) -> Array:
    """R (world from body, heading arbitrary) whose third row is the unit vector `up` of the body frame."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    north = np.cross(up, helper)
    north /= np.linalg.norm(north)
    return np.stack([np.cross(north, up), north, up])
