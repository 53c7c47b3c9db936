"""Readings that change otherwise than those of their neighbours on the ribbon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from firmware.c_arrays import view
from numpy.typing import NDArray
from ribbonhil._firmware import ffi, lib

COUNT: int = lib.RIBBON_NODE_COUNT
SIZE = 9.80665
STEP_S = 0.01
ALL = (1 << COUNT) - 1
NOISE = 0.0005 * SIZE

Readings = Callable[[float], NDArray[np.float64]]


class Watch:
    """Looks at readings, (COUNT, 3) as a function of time, with noise."""

    def __init__(self) -> None:
        self._drift = ffi.new("struct drift *")
        self._input = ffi.new("struct plausibility_input *")
        self._input.size = SIZE
        view(self._input.present, np.bool_)[:] = True
        self._rng = np.random.default_rng(1)
        self.t_s = 0.0
        self.trusted = ALL

    def run(self, readings: Readings, seconds: float) -> list[tuple[float, list[int]]]:
        """(time, sensors named) of every look."""
        looks = []
        for _ in range(round(seconds / STEP_S)):
            noise = self._rng.normal(0.0, NOISE, (COUNT, 3))
            view(self._input.readings)[:] = readings(self.t_s) + noise
            now_us = round(self.t_s * 1e6) % 2**32
            if lib.drift_is_due(self._drift, now_us):
                named = lib.drift_look(self._drift, self._input, self.trusted, now_us)
                looks.append((self.t_s, [i for i in range(COUNT) if named >> i & 1]))
            self.t_s += STEP_S
        return looks

    def reset(self) -> None:
        lib.drift_reset(self._drift)


def waving(period_s: float, turn_rad: float = 0.3) -> Readings:
    """Gravity along a ribbon that swings by 1 rad, and bends by turn_rad from sensor to sensor."""

    def at(t_s: float) -> NDArray[np.float64]:
        phase = 2 * np.pi * t_s / period_s
        angle = np.cos(phase) + turn_rad * np.sin(phase) * np.arange(COUNT)
        return SIZE * np.stack([np.sin(angle), 0.2 + 0 * angle, np.cos(angle)], -1)

    return at


slow = waving(60.0, 0.05)


def drifting(ribbon: Readings, sensor: int, rate: float, start_s: float, end_s: float = np.inf) -> Readings:
    """rate: share of the size a second, in a direction that changes with the sensor."""
    direction = np.random.default_rng(sensor).normal(size=3)
    direction *= rate * SIZE / np.linalg.norm(direction)

    def at(t_s: float) -> NDArray[np.float64]:
        readings = ribbon(t_s)
        if start_s <= t_s < end_s:
            readings[sensor] += direction * (t_s - start_s)
        return readings

    return at


def named(looks: list[tuple[float, list[int]]]) -> set[int]:
    return {i for _, sensors in looks for i in sensors}


@pytest.mark.parametrize("period_s", [0.5, 1.0, 3.0, 20.0])
def test_ribbon_that_swings_and_bends_does_not_drift(period_s):
    assert named(Watch().run(waving(period_s), 6.0)) == set()


@pytest.mark.parametrize("sensor", range(COUNT))
def test_drift_of_a_third_of_the_size_a_second_is_named_within_half_a_second(sensor):
    """While the ribbon moves slowly; it is named, and no other, until it is over."""
    looks = Watch().run(drifting(slow, sensor, 0.33, 1.0, 2.0), 4.0)
    assert named(looks) == {sensor}
    times_s = [t_s for t_s, sensors in looks if sensors]
    assert times_s[0] - 1.0 < 0.5
    assert times_s[-1] - 2.0 < 0.1
    assert len(times_s) == pytest.approx((times_s[-1] - times_s[0]) / 0.05 + 1, abs=1), "at every look"


def test_two_that_drift_are_both_named():
    readings = drifting(drifting(slow, 3, 0.33, 1.0), 11, 0.33, 1.0)
    assert named(Watch().run(readings, 1.5)) == {3, 11}


def test_sensor_that_changed_and_stays_is_believed_after_two_seconds():
    """The end of a ribbon was bent by hand, and is held so."""

    def bent(t_s: float) -> NDArray[np.float64]:
        readings = waving(1e9)(t_s)
        if t_s > 1.0:
            readings[COUNT - 1] = SIZE * np.array([np.sin(0.2), 0.2, np.cos(0.2)])
        return readings

    looks = Watch().run(bent, 6.0)
    times_s = [t_s for t_s, sensors in looks if sensors]
    assert named(looks) == {COUNT - 1}
    assert 2.9 < times_s[-1] < 3.2


def test_single_shock_names_nobody():
    def shaken(t_s: float) -> NDArray[np.float64]:
        readings = waving(1e9)(t_s)
        if abs(t_s - 1.5) < 0.02:
            readings[5] *= 2
        return readings

    assert named(Watch().run(shaken, 3.0)) == set()


def test_readings_that_are_not_trusted_neither_count_nor_are_named():
    watch = Watch()
    watch.trusted = ALL & ~(1 << 6)

    assert named(watch.run(drifting(slow, 6, 3.0, 0.0), 3.0)) == set()


def test_new_calibration_is_no_drift():
    watch = Watch()
    watch.run(waving(20.0), 2.0)
    watch.reset()
    rng = np.random.default_rng(4)
    offset = rng.normal(0.0, 0.1 * SIZE, (COUNT, 3))
    assert named(watch.run(lambda t_s: waving(20.0)(t_s) + offset, 2.0)) == set()


def test_clock_that_wraps_changes_nothing():
    watch = Watch()
    watch.t_s = 2**32 * 1e-6 - 1.2
    start_s = watch.t_s + 1.0
    looks = watch.run(drifting(slow, 8, 0.33, start_s), 1.6)
    assert named(looks) == {8}
    assert next(t_s for t_s, sensors in looks if sensors) - start_s < 0.5
