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
def test_cubic_is_interpolated_exactly_between_sensors(node):
    """To 2e-6 of values of the order of 1, single precision."""
    curve = polynomial(np.random.default_rng(node), 3)
    at = 2 * node + 1
    stencil = Stencil(at)
    assert len(stencil.index) == 4
    assert stencil.apply(curve(2 * np.arange(COUNT))) == pytest.approx(curve(at), abs=4e-6)


def test_last_node_is_extrapolated_by_a_parabola():
    """Exact for degree two, with a noise gain of sqrt(9 + 100 + 225) / 8 = 2.28 instead of a cubic's 3.38."""
    curve = polynomial(np.random.default_rng(1), 2)
    stencil = Stencil(31)
    assert stencil.apply(curve(2 * np.arange(COUNT))) == pytest.approx(curve(31), abs=4e-6)
    assert stencil.noise_gain() == pytest.approx(np.sqrt(9 + 100 + 225) / 8, rel=1e-6)


@pytest.mark.parametrize("dead", [(7,), (8,), (7, 8), (6, 9), (5, 7, 9)])
def test_dead_sensor_is_bridged_by_a_cubic_through_its_neighbours(dead):
    curve = polynomial(np.random.default_rng(2), 3)
    stencil = Stencil(15, dead)
    assert len(stencil.index) == 4
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
    curve = polynomial(np.random.default_rng(4), 3)
    stencil = Stencil(2 * 6, without=6)
    assert sorted(stencil.index) == [4, 5, 7, 8]
    assert stencil.weight[np.argsort(stencil.index)] == pytest.approx([-1 / 6, 4 / 6, 4 / 6, -1 / 6])
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
