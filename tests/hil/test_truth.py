"""What ideal sensors of a comb read, and where they are, at any time."""

import numpy as np
import pytest
from ribbonhil.scenes import BUILTIN, Scene, SceneError, load_scene
from ribbonhil.truth import GRAVITY_MPS2, Field, comb_truth, orthonormal, quaternions, resample, trace_comb
from ribbonhost.errors import UsageError
from scipy.spatial.transform import Rotation


def tilted(slope: float = 0.0) -> Scene:
    return Scene("plane", lambda x, y, t: slope * x)


def test_still_sensors_feel_gravity_and_the_field_in_their_own_frame():
    truth = comb_truth(tilted(np.tan(np.radians(30))), 3)
    reference, ribbons = truth.specific_force_mps2[:, 0], truth.specific_force_mps2[:, 1:]
    np.testing.assert_allclose(
        reference,
        np.broadcast_to([GRAVITY_MPS2 / 2, 0, GRAVITY_MPS2 * 0.75**0.5], reference.shape),
        atol=1e-9,
    )
    np.testing.assert_allclose(
        ribbons, np.broadcast_to([0, -GRAVITY_MPS2 / 2, GRAVITY_MPS2 * 0.75**0.5], ribbons.shape), atol=1e-9
    )
    flat = comb_truth(tilted(), 2, Field(dip_deg=60.0, strength_ut=50.0))
    np.testing.assert_allclose(flat.field_ut[0, 0, 0], [0, 25.0, -50 * 0.75**0.5], atol=1e-9)
    np.testing.assert_allclose(flat.field_ut[0, 1, 0], [25.0, 0, -50 * 0.75**0.5], atol=1e-9)


@pytest.mark.parametrize("name", list(BUILTIN))
def test_field_keeps_its_magnitude_and_dip_whatever_the_ribbon_does(name: str):
    truth = comb_truth(BUILTIN[name], 5)
    field = truth.field_ut
    np.testing.assert_allclose(np.linalg.norm(field, axis=-1), 48.0, rtol=1e-12)
    up = truth.r_world_node[..., 2, :]
    np.testing.assert_allclose(np.einsum("...i,...i", field, up), -48.0 * np.sin(np.radians(62)), rtol=1e-12)


@pytest.mark.parametrize("period_s", [20.0, 1.0])
def test_specific_force_holds_the_acceleration_of_the_sensor(period_s: float):
    """A surface that only rises and falls: every ribbon moves up and down as a whole."""
    lift = Scene("lift", lambda x, y, t: 0.02 * np.sin(2 * np.pi * t) + 0 * x, period_s)
    truth = comb_truth(lift, 2)
    rows = len(truth.position_m)
    expected = GRAVITY_MPS2 - 0.02 * (2 * np.pi / period_s) ** 2 * np.sin(2 * np.pi * np.arange(rows) / rows)
    got = truth.specific_force_mps2
    np.testing.assert_allclose(
        got[..., 2], np.broadcast_to(expected[:, None, None], got.shape[:3]), atol=1e-6
    )
    np.testing.assert_allclose(got[..., :2], 0, atol=1e-6)


def test_acceleration_on_the_wing_is_the_second_derivative_of_the_positions():
    truth = comb_truth(load_scene("wing", 2.0), 5)
    row, h_s = 90, 2e-3
    t_s = row / len(truth.position_m) * 2.0
    at = trace_comb(BUILTIN["wing"], 5, (t_s + h_s * np.arange(-2, 3)) / 2.0)
    weights = np.array([-1, 16, -30, 16, -1]) / (12 * h_s**2)
    acceleration = np.tensordot(weights, at.position_m, axes=1)
    frame = np.stack([at.tangent[2], at.binormal[2], at.normal[2]], axis=-1)
    expected = np.einsum("...ij,...i->...j", frame, acceleration + np.array([0, 0, GRAVITY_MPS2]))
    np.testing.assert_allclose(truth.specific_force_mps2[row], expected, atol=1e-5)
    assert np.abs(acceleration).max() > 1.0


@pytest.mark.parametrize(("name", "tolerance_m"), [("sea", 3e-5), ("wing", 1e-7), ("breath", 1e-7)])
def test_positions_between_rows_are_those_of_the_geodesics(name: str, tolerance_m: float):
    truth = comb_truth(BUILTIN[name], 5)
    t_s = np.random.default_rng(11).uniform(0, 60, 40)
    direct = trace_comb(BUILTIN[name], 5, t_s / 20.0)
    np.testing.assert_allclose(truth.slot_m(t_s), direct.position_m, atol=tolerance_m)
    np.testing.assert_allclose(truth.node_m(t_s), direct.position_m[:, :, 1::2], atol=tolerance_m)
    assert truth.node_m(float(t_s[0])).shape == (6, 16, 3)


def test_orientations_are_right_handed_and_agree_with_the_frames():
    truth = comb_truth(BUILTIN["wing"], 5)
    t_s = np.array([0.0, 3.3, 17.9])
    direct = trace_comb(BUILTIN["wing"], 5, t_s / 20.0)
    q = truth.q_world_slot(t_s)
    r = Rotation.from_quat(q[..., [1, 2, 3, 0]].reshape(-1, 4)).as_matrix().reshape(*q.shape[:-1], 3, 3)
    np.testing.assert_allclose(r[..., 0], direct.tangent, atol=1e-6)
    np.testing.assert_allclose(r[..., 1], direct.binormal, atol=1e-6)
    np.testing.assert_allclose(r[..., 2], direct.normal, atol=1e-6)


def test_quaternions_are_those_of_scipy_for_any_rotation():
    rotations = Rotation.random(2000, random_state=np.random.default_rng(2))
    half_turns = Rotation.from_rotvec(np.pi * np.eye(3))
    r = np.concatenate([rotations.as_matrix(), half_turns.as_matrix()])
    q = quaternions(r)
    expected = Rotation.from_matrix(r).as_quat()[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", q, expected)), 1, atol=1e-12)
    assert (q[:, 0] >= 0).all()


def test_orthonormal_keeps_rotations_and_mends_nearly_orthonormal_ones():
    r = Rotation.random(50, random_state=np.random.default_rng(4)).as_matrix()
    np.testing.assert_allclose(orthonormal(r), r, atol=1e-14)
    mended = orthonormal(r * 1.001)
    np.testing.assert_allclose(mended, r, atol=1e-14)


@pytest.mark.parametrize("count", [16, 17])
def test_resampling_is_exact_for_what_the_samples_resolve(count: int):
    t, fine = np.arange(count) / count, np.arange(64) / 64

    def signal(phase: np.ndarray) -> np.ndarray:
        return 0.3 + np.sin(2 * np.pi * 3 * phase) - 0.5 * np.cos(2 * np.pi * 6 * phase)

    np.testing.assert_allclose(resample(signal(t), 64), signal(fine), atol=1e-13)
    second = -((2 * np.pi * 3) ** 2) * np.sin(2 * np.pi * 3 * fine) + 0.5 * (2 * np.pi * 6) ** 2 * np.cos(
        2 * np.pi * 6 * fine
    )
    np.testing.assert_allclose(resample(signal(t), 64, derivative=2), second, atol=1e-10)


def test_motion_that_jumps_is_refused():
    jump = Scene("trapdoor", lambda x, y, t: 0.05 * np.where((t % 1) < 0.5, 1.0, -1.0) + 0 * x)
    with pytest.raises(SceneError, match="ribbons on trapdoor jump"):
        comb_truth(jump, 2)


@pytest.mark.parametrize("ribbons", [0, 7])
def test_impossible_number_of_ribbons_is_refused(ribbons: int):
    with pytest.raises(UsageError, match="an emulated comb has 1 to 6 ribbons"):
        comb_truth(tilted(), ribbons)
