"""Interpolation along the ribbon: exact where a polynomial is, with noise and error that are told."""

from __future__ import annotations

import numpy as np
import pytest
from firmware.c_arrays import vectors
from ribbonhil._firmware import ffi, lib

COUNT = 16
NONE = COUNT


class Stencil:
    """The stencil for a place (pitches from the first sensor) among sensors of which some are dead."""

    def __init__(self, at: float, dead: tuple[int, ...] = (), without: int = NONE) -> None:
        self.c = ffi.new("struct stencil *")
        valid = [i not in dead for i in range(COUNT)]
        lib.stencil_make(self.c, at, ffi.new("bool[]", valid), COUNT, without)

    @property
    def index(self) -> list[int]:
        return list(self.c.index)[: self.c.count]

    @property
    def weight(self) -> np.ndarray:
        return np.array(list(self.c.weight)[: self.c.count])

    def apply(self, values: np.ndarray) -> np.ndarray:
        out = ffi.new("float[3]")
        lib.stencil_apply(self.c, vectors(values), out)
        return np.array(list(out))

    def last_term(self, values: np.ndarray) -> float:
        return lib.stencil_last_term(self.c, vectors(values))

    def noise_gain(self) -> float:
        return float(np.sqrt(np.sum(self.weight**2)))


def polynomial(rng: np.random.Generator, degree: int):
    """A random vector polynomial of the place in pitches, of the order of 1 over the ribbon."""
    coefficients = rng.normal(size=(degree + 1, 3))
    return lambda s: np.stack([np.polyval(c, np.asarray(s) / 16 - 1) for c in coefficients.T], -1)


@pytest.mark.parametrize("node", range(COUNT - 1))
def test_polynomial_is_interpolated_exactly_between_sensors(node):
    """Degree five with three sensors on either side, else three; to 4e-6 of values of the order of 1."""
    points = 6 if 2 <= node <= COUNT - 4 else 4
    curve = polynomial(np.random.default_rng(node), points - 1)
    at = 2 * node + 1
    stencil = Stencil(at)
    assert len(stencil.index) == points
    assert stencil.apply(curve(2 * np.arange(COUNT))) == pytest.approx(curve(at), abs=4e-6)


def test_last_node_is_extrapolated_by_a_parabola():
    """Exact for degree two, with a noise gain of sqrt(9 + 100 + 225) / 8 = 2.28 instead of a cubic's 3.38."""
    curve = polynomial(np.random.default_rng(1), 2)
    stencil = Stencil(31)
    assert stencil.apply(curve(2 * np.arange(COUNT))) == pytest.approx(curve(31), abs=4e-6)
    assert stencil.noise_gain() == pytest.approx(np.sqrt(9 + 100 + 225) / 8, rel=1e-6)


@pytest.mark.parametrize(
    ("dead", "points"), [((7,), 6), ((8,), 6), ((7, 8), 6), ((6, 9), 6), ((5, 7, 9), 4), ((5, 6), 4)]
)
def test_dead_sensor_is_bridged_by_a_polynomial_through_its_neighbours(dead, points):
    curve = polynomial(np.random.default_rng(2), points - 1)
    stencil = Stencil(15, dead)
    assert len(stencil.index) == points
    assert not set(stencil.index) & set(dead)
    assert stencil.apply(curve(2 * np.arange(COUNT))) == pytest.approx(curve(15), abs=2e-5)


def test_noise_is_never_amplified_more_than_three_times():
    """For every node and every set of up to three dead sensors around it."""
    rng = np.random.default_rng(3)
    for node in range(COUNT):
        for _ in range(60):
            dead = tuple(rng.choice(COUNT, size=rng.integers(0, 4), replace=False).tolist())
            stencil = Stencil(2 * node + 1, dead)
            assert stencil.weight.sum() == pytest.approx(1, abs=1e-5)
            assert stencil.noise_gain() <= 3.0


def test_sensor_left_out_is_predicted_from_the_others():
    curve = polynomial(np.random.default_rng(4), 5)
    stencil = Stencil(2 * 6, without=6)
    assert sorted(stencil.index) == [3, 4, 5, 7, 8, 9]
    expected = np.array([1, -6, 15, 15, -6, 1]) / 20
    assert stencil.weight[np.argsort(stencil.index)] == pytest.approx(expected, rel=1e-5)
    assert stencil.apply(curve(2 * np.arange(COUNT))) == pytest.approx(curve(12), abs=4e-6)


def test_what_is_out_of_reach_says_nothing():
    assert Stencil(1, dead=tuple(range(5))).index == []
    assert Stencil(1, dead=tuple(range(COUNT))).index == []
    assert Stencil(1, dead=tuple(range(1, COUNT))).index == [0]


@pytest.mark.parametrize("turn", [0.05, 0.1, 0.2, 0.35, 0.5])
def test_error_on_a_bent_ribbon_is_told_by_the_last_term(turn):
    """Gravity turns by `turn` rad from sensor to sensor: 0.45 of the last term is at least the RMS error."""
    errors, told = [], []
    for phase in np.linspace(0, np.pi, 9):
        angle = turn * np.arange(COUNT) + phase
        values = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)
        for node in range(COUNT):
            stencil = Stencil(2 * node + 1)
            truth = turn * (node + 0.5) + phase
            errors.append(np.linalg.norm(stencil.apply(values) - [np.sin(truth), 0, np.cos(truth)]))
            told.append(0.45 * stencil.last_term(values))
    assert np.sqrt(np.mean(np.square(errors))) <= np.sqrt(np.mean(np.square(told))) + 1e-6
    assert max(errors) < 0.08, "5 deg even beyond the end of the tightest bend"


def test_variance_is_that_of_the_weighted_sum():
    rng = np.random.default_rng(5)
    variances = rng.uniform(0.1, 2, COUNT)
    stencil = Stencil(9)
    expected = np.sum(stencil.weight**2 * variances[stencil.index])
    got = lib.stencil_variance(stencil.c, ffi.new("float[]", variances.tolist()))
    assert got == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("at", [1, 15, 31])
def test_all_at_once_is_the_same_as_one_by_one(at):
    rng = np.random.default_rng(6)
    values, variances = rng.normal(size=(COUNT, 3)), ffi.new("float[]", rng.uniform(0.1, 2, COUNT).tolist())
    stencil = Stencil(at)
    out = ffi.new("float[3]")
    told = lib.stencil_apply_told(stencil.c, vectors(values), variances, out)
    assert list(out) == pytest.approx(stencil.apply(values).tolist(), rel=1e-5)
    assert told.last_term == pytest.approx(stencil.last_term(values), rel=1e-5)
    assert told.variance == pytest.approx(lib.stencil_variance(stencil.c, variances), rel=1e-5)
