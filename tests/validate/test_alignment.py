"""Recording and truth are brought together in time and space."""

import numpy as np
import pytest
from numpy.typing import NDArray
from ribbonhost.errors import ValidationError
from ribbonhost.validate.alignment import align, rigid_motion
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

OFFSET_S = 0.037
ROTATION = Rotation.from_rotvec([0.3, -0.5, 1.0])
TRANSLATION_M = np.array([1.0, 2.0, 3.0])
NOISE_M = 3e-4


def moving_points(t_s: Array) -> Array:
    """(T, 20, 3): a ribbon that swings about its start."""
    s = np.linspace(0, 1, 20)
    y = 0.1 * np.sin(t_s)[:, None] * s
    z = 0.1 * np.cos(1.3 * t_s)[:, None] * s**2
    return np.stack([np.broadcast_to(0.7 * s, y.shape), y, z], axis=-1)


def truth_of(t_s: Array) -> Array:
    return moving_points(t_s - OFFSET_S) @ ROTATION.as_matrix().T + TRANSLATION_M


@pytest.fixture
def recording() -> tuple[Array, Array]:
    t_s = np.arange(0, 10, 0.01)
    noise = np.random.default_rng(0).normal(scale=NOISE_M, size=(len(t_s), 20, 3))
    return t_s, moving_points(t_s) + noise


def test_offset_rotation_and_translation_are_found(recording: tuple[Array, Array]) -> None:
    truth_t_s = np.arange(-3, 14, 1 / 120)
    found = align(*recording, truth_t_s, truth_of(truth_t_s))
    assert found.offset_s == pytest.approx(OFFSET_S, abs=1e-3)
    assert abs(found.offset_s - OFFSET_S) < 4 * found.offset_sigma_s + 1e-5
    turn = Rotation.from_matrix(found.rotation) * ROTATION.inv()
    assert np.degrees(turn.magnitude()) < 0.05
    assert found.apply(np.zeros(3)) == pytest.approx(TRANSLATION_M, abs=1e-3)
    assert found.rms_m == pytest.approx(NOISE_M * np.sqrt(3), rel=0.05)


def test_points_that_the_cameras_lost_do_not_matter(recording: tuple[Array, Array]) -> None:
    truth_t_s = np.arange(-3, 14, 1 / 120)
    truth_m = truth_of(truth_t_s)
    truth_m[200:900, 4] = np.nan
    truth_m[:, 7] = np.nan
    found = align(*recording, truth_t_s, truth_m)
    assert found.offset_s == pytest.approx(OFFSET_S, abs=1e-3)


def test_a_known_offset_is_used_as_given(recording: tuple[Array, Array]) -> None:
    truth_t_s = np.arange(-3, 14, 1 / 120)
    found = align(*recording, truth_t_s, truth_of(truth_t_s), offset_s=OFFSET_S)
    assert found.offset_s == OFFSET_S
    assert found.rms_m < 1e-3


def test_what_does_not_move_has_no_offset(recording: tuple[Array, Array]) -> None:
    t_s, p_m = recording
    still = np.broadcast_to(p_m[0], p_m.shape)
    with pytest.raises(ValidationError, match="nothing moves"):
        align(t_s, still, t_s, still)


def test_times_that_do_not_overlap_are_refused(recording: tuple[Array, Array]) -> None:
    t_s, p_m = recording
    with pytest.raises(ValidationError, match="overlap"):
        align(t_s, p_m, t_s + 1000, p_m)


def test_points_on_a_line_leave_the_rotation_open() -> None:
    line = np.outer(np.arange(5.0), [1.0, 2.0, 3.0])
    with pytest.raises(ValidationError, match="line"):
        rigid_motion(line, line)
    with pytest.raises(ValidationError, match="at least 3"):
        rigid_motion(line[:2], line[:2])
