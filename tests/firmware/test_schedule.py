"""When scans start: evenly, without drift, where the host wants them."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from ribbonhil._firmware import ffi, lib

WRAP = 2**32


def started(rate_hz: int, first_us: int = 0):
    schedule = ffi.new("struct schedule *")
    lib.schedule_start(schedule, rate_hz, first_us)
    return schedule


@pytest.mark.parametrize("rate_hz", [1, 3, 7, 60, 99, 100, 128, 199, 200])
def test_scans_do_not_drift(rate_hz):
    """Scan n starts at n / rate, within 1 us, over 15,000 scans and over the wrap of the clock."""
    first_us = WRAP - 1_000_000
    schedule = started(rate_hz, first_us)
    for n in range(1, min(1800 * rate_hz, 15_000)):
        assert lib.schedule_advance(schedule, schedule.next_us) == 0
        exact_us = Fraction(n * 1_000_000, rate_hz)
        assert 0 <= exact_us - (schedule.next_us - first_us) % WRAP < 1


def test_late_scans_are_left_out_and_counted():
    schedule = started(100)
    assert lib.schedule_advance(schedule, 14_000) == 0, "a little late is still done"
    assert schedule.next_us == 10_000
    assert lib.schedule_advance(schedule, 44_000) == 2, "those of 20 and 30 ms"
    assert schedule.next_us == 40_000
    assert lib.schedule_advance(schedule, 41_000) == 0
    assert schedule.next_us == 50_000


def test_phase_moves_scans_by_half_a_period_at_most():
    rng = np.random.default_rng(1)
    for _ in range(2000):
        rate_hz = int(rng.integers(1, 201))
        now_us = int(rng.integers(0, WRAP))
        next_us = (now_us + int(rng.integers(0, 1_000_000 // rate_hz + 1))) % WRAP
        wanted_us = (now_us + int(rng.integers(-(2**30), 2**30))) % WRAP
        schedule = started(rate_hz, next_us)
        moved_us = lib.schedule_set_phase(schedule, wanted_us, now_us)
        period = Fraction(1_000_000, rate_hz)
        assert abs(moved_us) <= period / 2 + 1
        off = Fraction((schedule.next_us - wanted_us + WRAP // 2) % WRAP - WRAP // 2) % period
        assert min(off, period - off) <= 2, "whole periods away, within 2 us"
        assert (schedule.next_us - now_us) % WRAP < WRAP // 2, "not in the past"
        drift = Fraction((schedule.next_us - next_us - moved_us + WRAP // 2) % WRAP - WRAP // 2) % period
        assert min(drift, period - drift) <= 2, "moved as told, and by whole periods"


def test_time_is_compared_over_the_wrap():
    assert lib.schedule_is_past(WRAP - 5, 3)
    assert not lib.schedule_is_past(3, WRAP - 5)
    assert lib.schedule_is_past(7, 7)
