"""Ribbons that lie on a surface: geodesics at constant speed, many of them and many instants at once.

A ribbon bends but does not stretch nor turn within the surface, so its line is a geodesic.
"""

import math
from dataclasses import dataclass

import numpy as np

from ribbonhil.scenes import Array, Scene, SceneError, derivatives

STEP_MAX_M = 0.025
SPEED_TOLERANCE = 1e-5  # by which the speed may leave 1 where the steps are fine enough

# Cooper and Verner, SIAM J. Numer. Anal. 9 (1972): 11 stages, 8th order.
_S = np.sqrt(21.0)
_STAGES = (
    (),
    (1 / 2,),
    (1 / 4, 1 / 4),
    (1 / 7, (-7 - 3 * _S) / 98, (21 + 5 * _S) / 49),
    ((11 + _S) / 84, 0, (18 + 4 * _S) / 63, (21 - _S) / 252),
    ((5 + _S) / 48, 0, (9 + _S) / 36, (-231 + 14 * _S) / 360, (63 - 7 * _S) / 80),
    (
        (10 - _S) / 42,
        0,
        (-432 + 92 * _S) / 315,
        (633 - 145 * _S) / 90,
        (-504 + 115 * _S) / 70,
        (63 - 13 * _S) / 35,
    ),
    (1 / 14, 0, 0, 0, (14 - 3 * _S) / 126, (13 - 3 * _S) / 63, 1 / 9),
    (1 / 32, 0, 0, 0, (91 - 21 * _S) / 576, 11 / 72, (-385 - 75 * _S) / 1152, (63 + 13 * _S) / 128),
    (
        1 / 14,
        0,
        0,
        0,
        1 / 9,
        (-733 - 147 * _S) / 2205,
        (515 + 111 * _S) / 504,
        (-51 - 11 * _S) / 56,
        (132 + 28 * _S) / 245,
    ),
    (
        0,
        0,
        0,
        0,
        (-42 + 7 * _S) / 18,
        (-18 + 28 * _S) / 45,
        (-273 - 53 * _S) / 72,
        (301 + 53 * _S) / 72,
        (28 - 28 * _S) / 45,
        (49 - 7 * _S) / 18,
    ),
)
_WEIGHTS = (1 / 20, 0, 0, 0, 0, 0, 0, 49 / 180, 16 / 45, 49 / 180, 1 / 20)


@dataclass(frozen=True)
class Geodesics:
    """Points and Darboux frames at equal arc lengths; the last axes are (slot, component).

    position_m: (..., n, 3) in the world.
    tangent, binormal, normal: (..., n, 3) unit vectors: along the line, in the surface, up out of it;
        right-handed in this order: the node frame.
    """

    position_m: Array
    tangent: Array
    binormal: Array
    normal: Array


def trace(scene: Scene, t: Array, start_m: Array, direction: Array, pitch_m: float, count: int) -> Geodesics:
    """Geodesics of `count` points, `pitch_m` apart.

    t: (...) instants in periods.
    start_m: (..., 2) x and y of the first points.
    direction: (..., 3) in the world; its part in the surface is the direction of departure.

    Integrates x'' = -z_x k, y'' = -z_y k, k = z_vv / (1 + z_x^2 + z_y^2), z_vv the second derivative of the
    height along the velocity (x', y').

    Raises SceneError where the surface is too rough for that.
    """
    with np.errstate(all="ignore"):
        return _frames(scene, t, _states(scene, t, start_m, direction, pitch_m, count))


def _states(scene: Scene, t: Array, start_m: Array, direction: Array, pitch_m: float, count: int) -> Array:
    """x, y, x', y' of all points: (4, ..., count)."""
    x, y = (np.ascontiguousarray(np.broadcast_to(start_m[..., i], t.shape)) for i in range(2))
    zx, zy, _ = _slopes(scene, x, y, t, np.ones_like(x), np.zeros_like(x))
    normal = _unit(np.stack([-zx, -zy, np.ones_like(zx)], axis=-1))
    departure = _unit(direction - np.sum(direction * normal, axis=-1, keepdims=True) * normal)
    state = np.stack([x, y, departure[..., 0], departure[..., 1]])
    states = [state]
    steps = math.ceil(pitch_m / STEP_MAX_M - 1e-9)
    for _ in range(count - 1):
        for _ in range(steps):
            state = _step(scene, t, state, pitch_m / steps)
        states.append(state)
    return np.stack(states, axis=-1)


def _step(scene: Scene, t: Array, state: Array, h_m: float) -> Array:
    rates: list[Array] = []
    for row in _STAGES:
        stage = state.copy()
        for weight, rate in zip(row, rates, strict=True):
            if weight:
                stage += (h_m * weight) * rate
        rates.append(_rate(scene, t, stage))
    result = state.copy()
    for weight, rate in zip(_WEIGHTS, rates, strict=True):
        if weight:
            result += (h_m * weight) * rate
    return result


def _rate(scene: Scene, t: Array, state: Array) -> Array:
    """d(x, y, x', y') / ds."""
    x, y, vx, vy = state
    speed = np.hypot(vx, vy)
    zx, zy, z_uu = _slopes(scene, x, y, t, vx / speed, vy / speed)
    k = speed**2 * z_uu / (1 + zx**2 + zy**2)
    return np.stack([vx, vy, -zx * k, -zy * k])


def _slopes(scene: Scene, x: Array, y: Array, t: Array, ux: Array, uy: Array) -> tuple[Array, Array, Array]:
    """dz/dx, dz/dy, and the second derivative along the unit direction (ux, uy)."""
    try:
        ahead, left, second = derivatives(scene, x, y, t, ux, uy)
    except Exception as error:
        raise SceneError(f"height in {scene.name} failed on the way of a ribbon: {error}") from error
    return ux * ahead - uy * left, uy * ahead + ux * left, second


def _frames(scene: Scene, t: Array, states: Array) -> Geodesics:
    """Positions and frames from states (4, ..., n)."""
    x, y, vx, vy = states
    every_t = np.broadcast_to(t[..., None], x.shape)
    zx, zy, _ = _slopes(scene, x, y, every_t, np.ones_like(x), np.zeros_like(x))
    speed = np.sqrt(vx**2 + vy**2 + (zx * vx + zy * vy) ** 2)
    if not np.all(np.abs(speed - 1) < SPEED_TOLERANCE):
        i = np.unravel_index(np.argmin(np.abs(speed - 1) < SPEED_TOLERANCE), speed.shape)
        raise SceneError(
            f"the surface of {scene.name} is too rough for a ribbon near x = {x[i]:.3g} m, y = {y[i]:.3g} m, "
            f"t = {every_t[i]:.3g}: it must be smooth over about 0.1 m"
        )
    tangent = _unit(np.stack([vx, vy, zx * vx + zy * vy], axis=-1))
    normal = _unit(np.stack([-zx, -zy, np.ones_like(zx)], axis=-1))
    z = scene.height(x, y, every_t)
    return Geodesics(np.stack([x, y, z], axis=-1), tangent, np.cross(normal, tangent), normal)


def _unit(vectors: Array) -> Array:
    lengths: Array = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / lengths
