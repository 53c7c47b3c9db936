"""Rotation vectors and matrices, as the emulator's geometry uses them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def rotation_matrices(vectors_rad: ArrayLike) -> Array:
    """Matrices (..., 3, 3) that turn by rotation vectors (..., 3), in radians (Rodrigues)."""
    vectors = np.asarray(vectors_rad, dtype=np.float64)
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    zero = np.zeros(vectors.shape[:-1])
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vectors.shape[:-1], 3, 3)
    # sinc keeps both factors exact down to no rotation at all.
    along = np.sinc(angle / np.pi)
    twice = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + along * cross + twice * (cross @ cross))


def rotation_vectors(matrices: ArrayLike) -> Array:
    """Rotation vectors (..., 3) in radians, at most pi long, of matrices (..., 3, 3)."""
    r = np.asarray(matrices, dtype=np.float64)
    sine = 0.5 * np.stack(
        [r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], -1
    )
    cosine = 0.5 * (np.trace(r, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(np.linalg.norm(sine, axis=-1), cosine)[..., None]
    # Near half a turn the antisymmetric part vanishes: the axis is then a column of the symmetric part.
    column = 0.5 * (r + r.swapaxes(-1, -2)) - cosine[..., None, None] * np.eye(3)
    longest = np.argmax(np.einsum("...ii->...i", column), axis=-1)
    axis = np.take_along_axis(column, longest[..., None, None], axis=-1)[..., 0]
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    axis = np.where(np.sum(axis * sine, axis=-1, keepdims=True) < 0, -axis, axis)
    return np.asarray(np.where(angle > 3.0, angle * axis, sine / np.sinc(angle / np.pi)))
