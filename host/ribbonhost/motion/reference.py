"""The motion estimator's prediction and correction in plain NumPy: slow, obvious, the oracle of its tests.

Derivatives are central differences. Outliers are not looked for, and nothing is linearised twice.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import expm, null_space, solve_continuous_lyapunov
from scipy.spatial.transform import Rotation

from ribbonhost.motion.model import Float64, MotionParams, Samples

TWIST_MODES, BEND_MODES = 16, 18
OFFSET_SHAPES = 6
OFFSETS = 3 * OFFSET_SHAPES
STEP = 1e-6


@dataclass(frozen=True, eq=False)
class State:
    """root: (3, 3) orientation at the anchor. x: (states,) as in ribbon_motion.h, first three unused."""

    root: Float64
    x: Float64
    known_mps2: Float64


class Reference:
    """Model, prediction and correction for ribbons of 16 nodes or more."""

    def __init__(self, params: MotionParams) -> None:
        self.params = params
        self.slots = 2 * params.node_count
        self.block = 3 + TWIST_MODES + BEND_MODES
        self.states = 3 * self.block + OFFSETS + 9
        zeros, zeros_like = np.zeros, np.zeros_like
        self.segment = zeros((self.slots - 1, 3, TWIST_MODES + BEND_MODES))
        self.moment = zeros_like(self.segment)
        for axis, first, count in ((0, 0, TWIST_MODES), (1, TWIST_MODES, BEND_MODES)):
            part = slice(first, first + count)
            self.segment[:, axis, part], self.moment[:, axis, part] = self._integrals(count)
        normals = params.field_normals or [(0.0, 0.0, 1.0)] * params.node_count
        whole = np.tile(np.eye(3), (params.node_count, 1, 1))
        self.field_axes = (
            whole if params.field_axes == 3 else np.array([null_space([normal]).T for normal in normals])
        )
        u = np.linspace(-1.0, 1.0, params.node_count)
        powers, signs = np.linalg.qr(np.vander(u, OFFSET_SHAPES, increasing=True))
        self.offset_shape = powers * np.sign(np.diag(signs))
        low, high = 2 * np.pi * params.anchor_low_hz, 2 * np.pi * params.anchor_high_hz
        rest = 1 / params.persistence_s
        self.anchor_rate: Float64 = np.poly([-low, -low, -high])[:0:-1].astype(np.float64)
        self.shape_rate: Float64 = np.poly([0.0, -rest, -rest])[:0:-1].astype(np.float64)
        covariance = solve_continuous_lyapunov(_companion(self.anchor_rate), -np.diag([0.0, 0.0, 1.0]))
        self.anchor_covariance = covariance * params.anchor_sigma_mps2**2 / covariance[2, 2]

    def _integrals(self, count: int) -> tuple[Float64, Float64]:
        """(slots - 1, count) integrals of uniform cubic B-splines over the segments, and their first moments
        about the middle of each in units of the pitch."""
        s = np.arange(self.slots) * self.params.pitch_m
        knots = s[-1] / (count - 3) * np.arange(-3, count + 1)
        splines = [BSpline(knots, row, 3) for row in np.eye(count)]
        once, twice = (np.array([b.antiderivative(order)(s) for b in splines]).T for order in (1, 2))
        mean = (once[:-1] + once[1:]) / 2
        return np.diff(once, axis=0), mean - np.diff(twice, axis=0) / self.params.pitch_m

    def shape(self, state: State) -> tuple[Float64, Float64, Float64]:
        """Orientation (S, 3, 3), angular rate and acceleration (S, 3) of all slots, anchor's frame."""
        nb = self.block
        blocks = state.x[: 3 * nb].reshape(3, nb)[:, 3:]
        turn, speed, jolt = np.einsum("saj,ij->isa", self.segment, blocks)
        # Twist and bending do not commute: second term of the Magnus expansion, and its time derivatives.
        moment, moving, jolting = np.einsum("saj,ij->isa", self.moment, blocks)
        jolt = jolt + np.cross(jolt, moment) + 2 * np.cross(speed, moving) + np.cross(turn, jolting)
        speed = speed + np.cross(speed, moment) + np.cross(turn, moving)
        turn = turn + np.cross(turn, moment)
        rotation, rate, angular = [np.eye(3)], [state.x[nb : nb + 3]], [state.x[2 * nb : 2 * nb + 3]]
        for i in range(self.slots - 1):
            half = Rotation.from_rotvec(turn[i] / 2).as_matrix()
            middle = rotation[-1] @ half
            u = middle @ speed[i]
            angular.append(angular[-1] + middle @ jolt[i] + np.cross(rate[-1] + u / 2, u))
            rate.append(rate[-1] + u)
            rotation.append(middle @ half)
        r, w, a = np.array(rotation), np.array(rate), np.array(angular)
        tangent = r[:, :, 0]
        change = np.cross(a, tangent) + np.cross(w, np.cross(w, tangent))
        return r, w, self.integrate(change)

    def integrate(self, values: Float64) -> Float64:
        """(S, 3) integral along the ribbon of (S, 3): cubics through four neighbouring slots."""
        rules = np.array([[9.0, 19, -5, 1], [-1, 13, 13, -1], [1, -5, 19, 9]]) / 24
        total = [np.zeros(3)]
        for i in range(self.slots - 1):
            which = 0 if i == 0 else 2 if i + 2 == self.slots else 1
            total.append(total[-1] + self.params.pitch_m * rules[which] @ values[i - which : i - which + 4])
        return np.array(total)

    def predict_sensors(self, state: State) -> Float64:
        """What the sensors read in order: forces (n, 3), then fields (n, axes), flat."""
        r, w, acceleration = self.shape(state)
        force = np.einsum("sij,si->sj", r, acceleration + state.x[-3:])
        offset = self.offset_shape @ state.x[3 * self.block : -9].reshape(OFFSET_SHAPES, 3)
        field = np.einsum(
            "sij,si->sj", r, np.broadcast_to(state.root.T @ np.array(self.params.field_ut), w.shape)
        )
        later = np.cross(field, np.einsum("sij,si->sj", r, w))
        field = field + self.params.field_later_s * later
        return np.concatenate([(force[0::2] + offset).ravel(), self.along_axes(field[1::2]).ravel()])

    def along_axes(self, field: Float64) -> Float64:
        """(n, axes) of fields (n, 3) in the frames of the nodes: along the axes of the magnetometers."""
        return np.asarray(np.einsum("kad,kd->ka", self.field_axes, field))

    def add(self, state: State, d: Float64) -> State:
        """The state moved by an error d (states,)."""
        x = state.x + d
        x[:3] = 0.0
        return replace(state, root=Rotation.from_rotvec(d[:3]).as_matrix() @ state.root, x=x)

    def subtract(self, to: State, origin: State) -> Float64:
        """The error that leads from one state to another."""
        d = to.x - origin.x
        d[:3] = Rotation.from_matrix(to.root @ origin.root.T).as_rotvec()
        return d

    def advance(self, state: State, dt_s: float, known_mps2: Float64) -> State:
        """The state after a time, nothing new happening."""
        nb = self.block
        f, g = expm(_companion(self.shape_rate) * dt_s), expm(_companion(self.anchor_rate) * dt_s)
        blocks = state.x[: 3 * nb].reshape(3, nb)
        turn = f[0, 1] * blocks[1, :3] + f[0, 2] * blocks[2, :3]
        gravity = np.array([0.0, 0.0, self.params.gravity_mps2])
        anchor = state.x[-9:].reshape(3, 3).copy()
        offset = state.x[3 * nb : -9] * np.exp(-dt_s / self.params.offset_persistence_s)
        anchor[2] = state.root @ anchor[2] - gravity - state.known_mps2
        anchor = g @ anchor
        root = state.root @ Rotation.from_rotvec(turn).as_matrix()
        anchor[2] = root.T @ (anchor[2] + known_mps2 + gravity)
        x = np.concatenate([(f @ blocks).ravel(), offset, anchor.ravel()])
        x[:3] = 0.0
        return State(root, x, known_mps2)

    def advance_covariance(
        self,
        state: State,
        covariance: Float64,
        dt_s: float,
        known_mps2: Float64,
        jerk: Float64,
        offset: float,
        anchor: float,
    ) -> Float64:
        """The covariance (states, states) after that time.

        jerk: (5,), offset, anchor: as in ribbon_motion_scales.
        """
        nb, p, h = self.block, self.params, dt_s
        after = self.advance(state, dt_s, known_mps2)
        columns = [
            self.subtract(self.advance(self.add(state, d), dt_s, known_mps2), after)
            - self.subtract(self.advance(self.add(state, -d), dt_s, known_mps2), after)
            for d in STEP * np.eye(self.states)
        ]
        transition = np.array(columns).T / (2 * STEP)
        white = np.array(
            [[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]]
        )
        density = np.concatenate(
            [
                p.root_jerk**2 * jerk[:3],
                np.full(TWIST_MODES, p.twist_jerk**2 * jerk[3]),
                np.full(BEND_MODES, p.bend_jerk**2 * jerk[4]),
            ]
        )
        noise = np.zeros_like(covariance)
        # The jerk of the anchor's rotation is given in its own frame, the rotation in the world.
        to_world = np.eye(3 * nb)
        to_world[:3, :3] = state.root @ Rotation.from_rotvec(0.5 * dt_s * state.x[nb : nb + 3]).as_matrix()
        noise[: 3 * nb, : 3 * nb] = to_world @ np.kron(white, np.diag(density)) @ to_world.T
        lasting = np.exp(-2 * h / p.offset_persistence_s)
        noise[3 * nb : -9, 3 * nb : -9] = offset * p.accel_sigma_mps2**2 * (1 - lasting) * np.eye(OFFSETS)
        g = expm(_companion(self.anchor_rate) * dt_s)
        own = anchor * (self.anchor_covariance - g @ self.anchor_covariance @ g.T)
        noise[-9:, -9:] = np.kron(own, np.eye(3))
        # The noise of rotation and acceleration is given in the world; the state has the force in the frame.
        to_body = np.eye(self.states)
        to_body[-3:, -3:] = after.root.T
        to_body[-3:, :3] = after.root.T @ _cross_matrix(after.root @ after.x[-3:])
        return np.asarray(transition @ covariance @ transition.T + to_body @ noise @ to_body.T)

    def correct(
        self, state: State, covariance: Float64, samples: Samples, index: int
    ) -> tuple[State, Float64]:
        """State and covariance after a scan with all noise as the parameters say."""
        p = self.params
        rows = [
            self.predict_sensors(self.add(state, d)) - self.predict_sensors(self.add(state, -d))
            for d in STEP * np.eye(self.states)
        ]
        jacobian = np.array(rows).T / (2 * STEP)
        read = np.concatenate(
            [samples.force_mps2[index].ravel(), self.along_axes(samples.field_ut[index]).ravel()]
        )
        valid = np.concatenate(
            [
                np.repeat(samples.force_valid[index], 3),
                np.repeat(samples.field_valid[index], p.field_axes),
            ]
        )
        sigma = np.concatenate(
            [
                np.full(3 * p.node_count, p.accel_sigma_mps2),
                np.full(p.field_axes * p.node_count, p.field_sigma_ut),
            ]
        )
        innovation = (read - self.predict_sensors(state))[valid]
        h = jacobian[valid]
        s = h @ covariance @ h.T + np.diag(sigma[valid] ** 2)
        gain = np.linalg.solve(s, h @ covariance).T
        return self.add(state, gain @ innovation), covariance - gain @ h @ covariance


def _companion(rate: Float64) -> Float64:
    return np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], -np.asarray(rate)])


def _cross_matrix(v: Float64) -> Float64:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
