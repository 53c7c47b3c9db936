"""North and up to a quaternion, against SciPy over all rotations."""

from __future__ import annotations

import numpy as np
import pytest
from firmware.c_arrays import floats
from firmware.rotations import angle_deg, matrices, random_quaternions
from ribbonhil._firmware import ffi, lib
from scipy.spatial.transform import Rotation


def from_north_up(r: np.ndarray) -> np.ndarray:
    q = ffi.new("float[4]")
    lib.quaternion_from_north_up(floats(r[1]), floats(r[2]), q)
    return np.array(list(q))


def test_random_rotations_come_back():
    """To 3e-5 deg, single precision."""
    for q in random_quaternions(np.random.default_rng(1), 3000):
        assert angle_deg(from_north_up(matrices(q)), q) < 3e-5


@pytest.mark.parametrize("axis", [*np.eye(3).tolist(), [1, 1, 0], [0, 1, 1], [1, 1, 1], [1, -1, 1]])
@pytest.mark.parametrize("angle_of_deg", [0, 90, 120, 179.99, 180, 180.01, 270])
def test_half_turns_and_their_neighbours_come_back(axis, angle_of_deg):
    rotation = Rotation.from_rotvec(np.radians(angle_of_deg) * np.array(axis) / np.linalg.norm(axis))
    expected = np.roll(rotation.as_quat(), 1)
    got = from_north_up(rotation.as_matrix())
    assert angle_deg(got, expected) < 3e-5
    assert got[0] >= 0
