"""Rotations as matrices, many at once."""

import numpy as np

from ribbonhost.calibrate.sensor_errors import Array


def skew(v: Array) -> Array:
    """[v]x of vectors (..., 3) as matrices (..., 3, 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def rotation(w: Array) -> Array:
    """Rotation matrices (P, 3, 3) of rotation vectors (P, 3) (Rodrigues)."""
    angle = np.linalg.norm(w, axis=-1)[:, None, None]
    k = skew(w)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0, np.sin(safe) / safe)
    b = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    return np.asarray(np.eye(3) + a * k + b * (k @ k))


def about_up(count: int) -> Array:
    """(count, 3, 3) equal turns about the vertical, a whole turn together."""
    turns = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return rotation(np.stack([np.zeros(count), np.zeros(count), turns], axis=1))


def with_up(up: Array) -> Array:
    """R (world from body, heading arbitrary) whose third row is the unit vector `up` of the body frame."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    north = np.cross(up, helper)
    north /= np.linalg.norm(north)
    return np.stack([np.cross(north, up), north, up])


def field_world_ut(strength_ut: float, dip_rad: float) -> Array:
    """(3,) the local field, world frame."""
    return strength_ut * np.array([0.0, np.cos(dip_rad), -np.sin(dip_rad)])
