"""Rotations in double precision, told apart from the firmware's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def random_quaternions(rng: np.random.Generator, count: int) -> Array:
    """(count, 4) unit quaternions, scalar first, uniform over all rotations."""
    q: Array = rng.normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def matrices(q: Array) -> Array:
    """(..., 3, 3) rotation matrices of unit quaternions (..., 4): world = matrix @ node."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def angle_deg(a: Array, b: Array) -> Array:
    """Angle of the rotation between unit quaternions, degrees, exact for small ones."""
    sign = np.sign(np.sum(a * b, axis=-1, keepdims=True))
    return np.degrees(4 * np.arcsin(np.minimum(np.linalg.norm(a - sign * b, axis=-1) / 2, 1)))


def field_world_ut(dip_deg: float = 62.0, strength_ut: float = 48.0) -> Array:
    """The field of the world: north and down."""
    dip = np.radians(dip_deg)
    return strength_ut * np.array([0.0, np.cos(dip), -np.sin(dip)])
