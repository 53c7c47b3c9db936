"""Moving surfaces z = height(x, y, t) that emulated ribbons lie on: three built in, others from a file.

World frame: x east, y north, z up, metres; t counts periods of the motion, which repeats after one.
"""

import runpy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from ribbonhost.errors import UsageError

Array = NDArray[np.float64]
Height = Callable[[Array, Array, Array], Array]

DEFAULT_PERIOD_S = 20.0
PERIOD_TOLERANCE_M = 1e-9  # by which the heights at t = 0 and t = 1 may differ: rounding, not motion

# Central differences of 6th order. The step balances truncation against rounding: both stay below 1e-9 on
# surfaces that bend over 0.1 m or more.
_STEP_M = 2.5e-3
_AHEAD = np.array([-3, -2, -1, 0, 1, 2, 3, 0, 0, 0, 0, 0, 0]) * _STEP_M
_LEFT = np.array([0, 0, 0, 0, 0, 0, 0, -3, -2, -1, 1, 2, 3]) * _STEP_M
_WEIGHTS = np.array(
    [
        np.array([-1, 9, -45, 0, 45, -9, 1, 0, 0, 0, 0, 0, 0]) / (60 * _STEP_M),
        np.array([0, 0, 0, 0, 0, 0, 0, -1, 9, -45, 45, -9, 1]) / (60 * _STEP_M),
        np.array([2, -27, 270, -490, 270, -27, 2, 0, 0, 0, 0, 0, 0]) / (180 * _STEP_M**2),
    ]
)


class SceneError(UsageError):
    """A scene that cannot be used."""


@dataclass(frozen=True)
class Scene:
    """A surface that moves with a period.

    height: function of three float64 arrays of one shape, x_m, y_m (metres) and t (periods), that returns
        the height in metres, float64, in that shape; smooth in all three, height(x, y, 0) = height(x, y, 1).
    """

    name: str
    height: Height
    period_s: float = DEFAULT_PERIOD_S


def sea(x_m: Array, y_m: Array, t: Array) -> Array:
    """A wave that travels east, swaying north and south."""
    phase = 2 * np.pi * (x_m / 0.5 - t)
    return 0.06 * np.sin(phase) * np.cos(2 * np.pi * y_m / 0.6 + 0.7 * np.sin(2 * np.pi * t))


def wing(x_m: Array, y_m: Array, t: Array) -> Array:
    """A wing fixed along y = 0 that bends and twists."""
    bend = 0.35 * np.sin(2 * np.pi * t)
    twist = 0.6 * np.cos(2 * np.pi * t)
    return 1.5 * bend * y_m**2 * (1.5 - y_m) + twist * (x_m - 0.15) * y_m * (0.3 + y_m)


def breath(x_m: Array, y_m: Array, t: Array) -> Array:
    """A bump that swells and sinks."""
    amplitude = 0.12 * (1 + 0.5 * np.sin(2 * np.pi * t))
    return amplitude * np.exp(-((x_m - 0.3) ** 2 + (y_m - 0.35) ** 2) / (2 * 0.16**2))


BUILTIN = {height.__name__: Scene(height.__name__, height) for height in (sea, wing, breath)}


def load_scene(name: str, period_s: float | None = None) -> Scene:
    """The built-in scene of that name, or the one in a Python file (a name that ends in .py).

    Such a file defines PERIOD_S and height(x_m, y_m, t), see Scene; it is executed. period_s overrides the
    scene's own period.

    Raises SceneError if there is no such scene or the file's cannot be used.
    """
    scene = _from_file(Path(name)) if name.endswith(".py") else BUILTIN.get(name)
    if scene is None:
        raise SceneError(
            f"there is no scene {name!r}: give {', '.join(BUILTIN)}, or a Python file that ends in .py"
        )
    if period_s is not None:
        scene = Scene(scene.name, scene.height, _checked_period(period_s, "the period"))
    return scene


def derivatives(
    scene: Scene, x_m: Array, y_m: Array, t: Array, ux: Array, uy: Array
) -> tuple[Array, Array, Array]:
    """Derivatives of the height at points of one shape, along horizontal unit directions (ux, uy).

    Returns the slope along the direction, the slope to the left of it, and the second derivative along it
    (1/m). Accurate to 1e-8 on surfaces that bend over 0.1 m or more.
    """
    column = (-1,) + (1,) * x_m.ndim
    ahead_m, left_m = _AHEAD.reshape(column), _LEFT.reshape(column)
    x = x_m + ahead_m * ux - left_m * uy
    y = y_m + ahead_m * uy + left_m * ux
    z = scene.height(x, y, np.broadcast_to(t, x.shape))
    along, across, bend = (_WEIGHTS @ z.reshape(len(_AHEAD), -1)).reshape(3, *x_m.shape)
    return along, across, bend


def _checked_period(value: object, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.01 <= value <= 1e6:
        raise SceneError(f"{what} must be a number of seconds between 0.01 and 1000000, it is {value!r}")
    return float(value)


def _from_file(path: Path) -> Scene:
    """Executes the file and tries its height on a grid."""
    if not path.is_file():
        raise SceneError(f"there is no scene file {path}")
    try:
        names = runpy.run_path(str(path), run_name=path.stem)
    except (Exception, SystemExit) as error:
        raise SceneError(f"{path} cannot be executed: {_describe(error)}") from error
    for needed in ("PERIOD_S", "height"):
        if needed not in names:
            raise SceneError(
                f"{path} does not define {needed}; a scene needs PERIOD_S and height(x_m, y_m, t)"
            )
    if not callable(names["height"]):
        raise SceneError(f"height in {path} is not a function; it must be height(x_m, y_m, t)")
    scene = Scene(str(path), names["height"], _checked_period(names["PERIOD_S"], f"PERIOD_S in {path}"))
    _check_height(scene)
    return scene


def _check_height(scene: Scene) -> None:
    """Tries the height where ribbons may lie: raises SceneError for what a scene must not do."""
    # The check of the shape needs sides of different length.
    t, x_m, y_m = np.meshgrid(
        [0.0, 0.37, 1.0], np.linspace(0.0, 0.8, 7), np.linspace(0.0, 0.8, 5), indexing="ij"
    )
    where = f"height in {scene.name}"
    try:
        with np.errstate(all="ignore"):
            z_m = scene.height(x_m, y_m, t)
    except Exception as error:
        raise SceneError(f"{where} failed on arrays: {_describe(error)}") from error
    if not isinstance(z_m, np.ndarray) or z_m.shape != x_m.shape:
        shape = getattr(z_m, "shape", None)
        found = f"an array of shape {shape}" if shape is not None else type(z_m).__name__
        raise SceneError(
            f"{where} must return an array of the shape it is given, {x_m.shape}; it returned {found}"
        )
    if z_m.dtype != np.float64:
        raise SceneError(f"{where} must return float64, which its derivatives need; it returned {z_m.dtype}")
    if not np.isfinite(z_m).all():
        i = np.unravel_index(np.argmin(np.isfinite(z_m)), z_m.shape)
        raise SceneError(f"{where} is {z_m[i]} at x = {x_m[i]:g} m, y = {y_m[i]:g} m, t = {t[i]:g}")
    jump_m = float(np.abs(z_m[0] - z_m[-1]).max())
    if jump_m > PERIOD_TOLERANCE_M:
        raise SceneError(f"{where} is not periodic: between t = 0 and t = 1 it changes by {jump_m:.3g} m")


def _describe(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0].rstrip(": ")
