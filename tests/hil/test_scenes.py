"""Scenes: what their derivatives are worth, and what is said about a file that cannot be used."""

from pathlib import Path

import numpy as np
import pytest
from ribbonhil.scenes import BUILTIN, Scene, SceneError, derivatives, load_scene

GOOD = """
import numpy as np
PERIOD_S = 12.5
def height(x_m, y_m, t):
    return 0.05 * np.sin(2 * np.pi * t) * np.cos(4 * x_m) + 0.1 * y_m
"""


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "my_scene.py"
    path.write_text(text)
    return str(path)


def exact(name: str, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """zx, zy, zxx, zxy, zyy by hand."""
    if name == "sea":
        k, m = 2 * np.pi / 0.5, 2 * np.pi / 0.6
        p, q = k * x - 2 * np.pi * t, m * y + 0.7 * np.sin(2 * np.pi * t)
        s, c, sq, cq = np.sin(p), np.cos(p), np.sin(q), np.cos(q)
        return (
            0.06 * k * c * cq,
            -0.06 * m * s * sq,
            -0.06 * k * k * s * cq,
            -0.06 * k * m * c * sq,
            -0.06 * m * m * s * cq,
        )
    if name == "wing":
        a, b = 0.35 * np.sin(2 * np.pi * t), 0.6 * np.cos(2 * np.pi * t)
        return (
            b * y * (0.3 + y),
            1.5 * a * (3 * y - 3 * y * y) + b * (x - 0.15) * (0.3 + 2 * y),
            np.zeros_like(x),
            b * (0.3 + 2 * y),
            1.5 * a * (3 - 6 * y) + 2 * b * (x - 0.15),
        )
    u, v, w = (x - 0.3) / 0.16**2, (y - 0.35) / 0.16**2, 1 / 0.16**2
    g = 0.12 * (1 + 0.5 * np.sin(2 * np.pi * t)) * np.exp(-(u * u + v * v) / (2 * w))
    return -u * g, -v * g, (u * u - w) * g, u * v * g, (v * v - w) * g


@pytest.mark.parametrize("name", list(BUILTIN))
def test_derivatives_are_exact_to_1e_8(name: str):
    rng = np.random.default_rng(7)
    x, y, t, angle = (
        rng.uniform(0, 0.8, 2000),
        rng.uniform(0, 0.8, 2000),
        rng.random(2000),
        rng.uniform(0, 7, 2000),
    )
    ux, uy = np.cos(angle), np.sin(angle)
    ahead, left, second = derivatives(BUILTIN[name], x, y, t, ux, uy)
    zx, zy, zxx, zxy, zyy = exact(name, x, y, t)
    np.testing.assert_allclose(ahead, ux * zx + uy * zy, atol=1e-8)
    np.testing.assert_allclose(left, ux * zy - uy * zx, atol=1e-8)
    np.testing.assert_allclose(second, ux * ux * zxx + 2 * ux * uy * zxy + uy * uy * zyy, atol=1e-8)


def test_builtin_scenes_have_a_period_of_20_s_unless_told_otherwise():
    assert load_scene("wing").period_s == 20.0
    assert load_scene("wing", 2.5).period_s == 2.5


def test_file_is_a_scene_of_the_same_kind(tmp_path: Path):
    scene = load_scene(written(tmp_path, GOOD))
    assert isinstance(scene, Scene)
    assert scene.period_s == 12.5
    x, y, t = np.array([0.2, 0.3]), np.array([0.1, 0.4]), np.array([0.25, 0.5])
    np.testing.assert_allclose(scene.height(x, y, t), 0.05 * np.array([1, 0]) * np.cos(4 * x) + 0.1 * y)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def height(x, y, t): return 0 * x", "does not define PERIOD_S"),
        ("PERIOD_S = 3", "does not define height"),
        ("PERIOD_S = 3\nheight = 4", "height in .* is not a function"),
        ("PERIOD_S = 0\ndef height(x, y, t): return 0 * x", "PERIOD_S in .* must be a number of seconds"),
        ("PERIOD_S = 'long'\ndef height(x, y, t): return 0 * x", "PERIOD_S in .* must be a number .* 'long'"),
        ("PERIOD_S = 3\ndef height(x, y): return 0 * x", r"height in .* failed on arrays: TypeError"),
        ("PERIOD_S = 3\ndef height(x, y, t): return 0.0", "must return an array .* it returned float"),
        ("PERIOD_S = 3\ndef height(x, y, t): return x[0]", "must return an array of the shape it is given"),
        ("PERIOD_S = 3\ndef height(x, y, t): return (0 * x).astype('f4')", "must return float64.* float32"),
        ("PERIOD_S = 3\ndef height(x, y, t): return (x - 0.5) ** 0.5", "is nan at x = 0 m, y = 0 m, t = 0"),
        ("PERIOD_S = 3\ndef height(x, y, t): return 0.01 * t", r"is not periodic: .* changes by 0.01 m"),
        ("PERIOD_S = 3\ndef height(x, y, t): return y / 0", "failed on arrays|is nan"),
        ("import no_such_module", "cannot be executed: ModuleNotFoundError"),
        ("def height(:", "cannot be executed: SyntaxError"),
        ("raise SystemExit(3)", "cannot be executed: SystemExit: 3"),
    ],
)
def test_unusable_file_gives_one_sentence(tmp_path: Path, text: str, message: str):
    with pytest.raises(SceneError, match=message) as caught:
        load_scene(written(tmp_path, text))
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


def test_missing_file_and_unknown_name_say_so():
    with pytest.raises(SceneError, match=r"there is no scene file nowhere\.py"):
        load_scene("nowhere.py")
    with pytest.raises(SceneError, match="there is no scene 'see': give sea, wing, breath, or a Python file"):
        load_scene("see")
    with pytest.raises(SceneError, match="the period must be a number"):
        load_scene("sea", float("nan"))
