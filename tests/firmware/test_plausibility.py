"""Readings that do not fit in with their neighbours on the ribbon."""

from __future__ import annotations

import numpy as np
import pytest
from firmware.c_arrays import view
from ribbonhil._firmware import ffi, lib

COUNT: int = lib.RIBBON_NODE_COUNT
SIZE = 9.80665


def suspects(readings, *, present=None, before=(), two_axes=False) -> list[int]:
    data = ffi.new("struct plausibility_input *")
    view(data.readings)[:] = readings
    view(data.present, np.bool_)[:] = True if present is None else present
    data.size, data.has_two_axes = SIZE, two_axes
    suspect = ffi.new("bool[]", [i in before for i in range(COUNT)])
    lib.plausibility_check(data, suspect)
    return [i for i in range(COUNT) if suspect[i]]


def bent(turn_rad: float, phase: float = 0.3) -> np.ndarray:
    """Gravity along a ribbon that turns by so much from sensor to sensor."""
    angle = phase + turn_rad * np.arange(COUNT)
    return SIZE * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)


@pytest.mark.parametrize("turn_rad", [0.0, 0.3, 0.6, 0.7])
def test_bent_ribbon_is_plausible(turn_rad):
    """Up to a radius of 7 cm: 0.7 rad from sensor to sensor."""
    for phase in np.linspace(0, 6, 13):
        assert suspects(bent(turn_rad, phase)) == []


@pytest.mark.parametrize("at", range(COUNT))
@pytest.mark.parametrize("turn_rad", [0.0, 0.25])
def test_wrong_reading_is_found_and_no_other(at, turn_rad):
    """Off by one g in any direction, at any place, the ends included."""
    rng = np.random.default_rng(at)
    for _ in range(20):
        readings = bent(turn_rad)
        off = rng.normal(size=3)
        readings[at] += SIZE * off / np.linalg.norm(off)
        assert suspects(readings) == [at]


@pytest.mark.parametrize("two_axes", [False, True])
@pytest.mark.parametrize("at", range(COUNT))
def test_reading_that_goes_astray_is_blamed_and_no_other(at, two_axes):
    """By a fiftieth of g at a time, in any direction, on a bent ribbon: who is suspect first is the one."""
    rng = np.random.default_rng(at)
    for _ in range(20):
        direction = rng.normal(size=3)
        direction *= 0.02 * SIZE / np.linalg.norm(direction)
        readings = bent(0.05)
        while not (found := suspects(readings, two_axes=two_axes)):
            readings[at] += direction
        assert found == [at]


def test_length_tells_where_direction_does_not():
    readings = bent(0.25)
    readings[6] *= 1.18
    assert suspects(readings) == [6]
    assert suspects(readings, two_axes=True) == []


def test_two_wrong_readings_are_found():
    readings = bent(0.2)
    readings[3] *= -1
    readings[11] = [0, SIZE, 0]
    assert suspects(readings) == [3, 11]


def test_suspect_is_judged_by_those_who_are_trusted():
    readings = bent(0.2)
    readings[5] *= -1
    assert suspects(readings, before=(5,)) == [5]
    readings[5] = bent(0.2)[5]
    assert suspects(readings, before=(5,)) == []


def test_shaken_ribbon_is_plausible():
    """All sensors share an acceleration that grows along the ribbon, up to 1.5 g at its end."""
    share = (np.arange(COUNT) / (COUNT - 1))[:, None] ** 2
    assert suspects(bent(0.2) + 1.5 * SIZE * share * np.array([0.6, 0, 0.8])) == []


def test_absent_readings_say_nothing():
    readings = bent(0.2)
    present = np.ones(COUNT, bool)
    present[[4, 9]] = False
    readings[[4, 9]] = np.nan
    assert suspects(readings, present=present) == []
    assert suspects(readings, present=np.zeros(COUNT, bool)) == []
    lonely = np.zeros(COUNT, bool)
    lonely[[2, 13]] = True
    assert suspects(-readings, present=lonely) == []
