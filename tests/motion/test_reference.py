"""The C motion estimator agrees with its NumPy reference, prediction by prediction."""

import numpy as np
import pytest
from ribbonhost.motion import MotionParams, Samples
from ribbonhost.motion.reference import Reference, State
from ribbonhost.native._native import ffi, lib
from scipy.spatial.transform import Rotation

PARAMS = MotionParams(field_later_s=0.004)
STATES = 138
ROWS = lib.RIBBON_MOTION_MATRIX_MAX
JERK = np.array([1e-6, 3e-6, 1e-7, 2e-6, 5e-7])


class Native:
    """One step of the C estimator on states of the reference."""

    def __init__(self, params: MotionParams) -> None:
        self.model = ffi.new("struct ribbon_motion_model *")
        assert lib.ribbon_motion_model_init(self.model, params.to_c()) == 0
        self.memory = ffi.new("double[]", lib.ribbon_motion_work_bytes() // 8 + 1)
        self.work = ffi.cast("struct ribbon_motion_work *", self.memory)
        self.step = ffi.new("struct ribbon_motion_step *")
        self.scales = ffi.new("struct ribbon_motion_scales *", [1.0, 1.0, 0.5, [1.0] * 5, 1.0, 0.0])

    def put(self, state: State, covariance: np.ndarray, t_s: float) -> None:
        for place in (self.step.state, self.step.predicted):
            place.t_s = t_s
            place.root = list(state.root.ravel())
            place.known_mps2 = list(state.known_mps2)
            place.x = list(state.x)
        for matrix in (self.step.covariance, self.step.predicted_covariance):
            self.taken_matrix(matrix)[:] = covariance

    @staticmethod
    def taken_matrix(matrix: object) -> np.ndarray:
        return np.frombuffer(ffi.buffer(matrix)).reshape(ROWS, ROWS)[:STATES, :STATES]

    @staticmethod
    def taken(state: object) -> State:
        return State(
            np.array(list(state.root)).reshape(3, 3),
            np.array(list(state.x)),
            np.array(list(state.known_mps2)),
        )


def some_state(reference: Reference, random: np.random.Generator) -> State:
    nb = reference.block
    x = random.normal(size=reference.states)
    x[3:nb] *= 2.0
    x[nb : 2 * nb] *= 2.0
    x[2 * nb : 3 * nb] *= 10.0
    x[:3] = 0.0
    root = Rotation.from_rotvec(random.normal(size=3)).as_matrix()
    x[-3:] = root.T @ np.array([0.5, -1.0, 10.5])
    return State(root, x, np.array([0.3, 0.1, -0.2]))


def some_covariance(reference: Reference, random: np.random.Generator, size: float) -> np.ndarray:
    mix = random.normal(size=(reference.states, reference.states)) / np.sqrt(reference.states)
    return size**2 * (mix @ mix.T + 0.1 * np.eye(reference.states))


def one_sample(reference: Reference, values: np.ndarray) -> Samples:
    n = reference.params.node_count
    field = np.einsum("kad,ka->kd", reference.field_axes, values[3 * n :].reshape(n, -1))[None]
    valid = np.ones((1, n), bool)
    return Samples(
        t_s=np.array([1.0]),
        force_mps2=values[: 3 * n].reshape(1, n, 3),
        field_ut=field,
        force_valid=valid,
        field_valid=valid.copy(),
        level_q=np.tile([1.0, 0.0, 0.0, 0.0], (1, n, 1)),
        level_valid=valid,
        level_still=np.zeros(1, bool),
        anchor_mps2=np.zeros((1, 3)),
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_nodes_of_a_state_agree_to_rounding(seed: int) -> None:
    random = np.random.default_rng(seed)
    reference, native = Reference(PARAMS), Native(PARAMS)
    state = some_state(reference, random)
    native.put(state, np.eye(STATES), 0.0)
    nodes = ffi.new("struct ribbon_motion_nodes *")
    lib.ribbon_motion_output(native.model, ffi.addressof(native.step.state), ffi.NULL, nodes, native.work)
    r, w, acceleration = reference.shape(state)

    def taken(name: str) -> np.ndarray:
        return np.frombuffer(ffi.buffer(getattr(nodes, name))).reshape(32, 3)[:16]

    def expected(inner: np.ndarray) -> np.ndarray:
        return (inner @ state.root.T)[1::2]

    tangent = r[:, :, 0]
    np.testing.assert_allclose(taken("rate_radps"), expected(w), atol=1e-12)
    np.testing.assert_allclose(taken("acceleration_mps2"), expected(acceleration), atol=1e-10)
    np.testing.assert_allclose(taken("position_m"), expected(reference.integrate(tangent)), atol=1e-13)
    velocity = reference.integrate(np.cross(w, tangent))
    np.testing.assert_allclose(taken("velocity_mps"), expected(velocity), atol=1e-11)


@pytest.mark.parametrize("dt_s", [0.01, 0.3])
def test_prediction_agrees(dt_s: float) -> None:
    random = np.random.default_rng(2)
    reference, native = Reference(PARAMS), Native(PARAMS)
    state = some_state(reference, random)
    state.x[reference.block : 3 * reference.block] *= 0.01 / dt_s
    covariance = some_covariance(reference, random, 1e-4)
    native.put(state, covariance, 1.0 - dt_s)
    native.scales.jerk, native.scales.anchor = list(JERK), 1e-3
    sample = one_sample(reference, np.zeros(80)).to_c(16, np.zeros((1, 16)))
    assert lib.ribbon_motion_advance(native.model, sample, native.scales, native.step, native.step) == 0
    after = reference.advance(state, dt_s, np.zeros(3))
    np.testing.assert_allclose(reference.subtract(native.taken(native.step.predicted), after), 0.0, atol=1e-9)
    expected = reference.advance_covariance(state, covariance, dt_s, np.zeros(3), JERK, 0.5, 1e-3)
    # The turn of the anchor's frame during the step is taken halfway: second order in the turn.
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((native.taken_matrix(native.step.predicted_covariance) - expected) / scale).max() < 5e-3


TILTED = tuple((0.1 * np.sin(k), 0.1 * np.cos(k), 1.2) for k in range(16))


@pytest.mark.parametrize(("field_axes", "normals"), [(2, None), (2, TILTED), (3, None)])
def test_correction_agrees(field_axes: int, normals: tuple[tuple[float, float, float], ...] | None) -> None:
    random = np.random.default_rng(3)
    params = MotionParams(field_axes=field_axes, field_normals=normals)
    reference, native = Reference(params), Native(params)
    state = some_state(reference, random)
    covariance = some_covariance(reference, random, 1e-3)
    truth = reference.add(state, np.linalg.cholesky(covariance) @ random.normal(size=STATES))
    samples = one_sample(reference, reference.predict_sensors(truth))
    # What a magnetometer does not feel may be anything.
    if field_axes == 2:
        samples.field_ut[0] += 20.0 * np.array(normals or [(0.0, 0.0, 1.0)] * 16)
    samples.force_valid[0, 3] = samples.field_valid[0, 7] = False
    samples.force_mps2[0, 3] = np.nan
    native.put(state, covariance, 1.0)
    fit = ffi.new("struct ribbon_motion_fit *")
    error = lib.ribbon_motion_correct(
        native.model,
        samples.to_c(16, np.zeros((1, 16))),
        ffi.addressof(native.step.predicted),
        native.scales,
        native.step,
        fit,
        native.work,
    )
    assert error == 0
    assert fit.forces == fit.fields == 15
    expected, expected_covariance = reference.correct(state, covariance, samples, 0)
    sigma = np.sqrt(np.diag(expected_covariance))
    off = reference.subtract(native.taken(native.step.state), expected) / sigma
    # The derivative of a segment's turn is taken halfway: 0.2 % of it at 0.2 rad a segment.
    assert np.abs(off).max() < 0.3
    covariance = native.taken_matrix(native.step.covariance)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), sigma, rtol=0.02)
