"""A device's clock is found from pings, whatever the link does to them."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ribbonhost.clock import STEP_EXCHANGES, WINDOW, WRAP_US, DeviceClock, extend_us

Delay = Callable[[np.random.Generator], tuple[float, float]]


def cable(rng: np.random.Generator) -> tuple[float, float]:
    """Tens of microseconds each way, and now and then a scan that must end first."""
    return rng.uniform(50e-6, 80e-6) + rng.choice([0, 3e-3], p=[0.7, 0.3]), rng.uniform(50e-6, 80e-6)


def bluetooth(rng: np.random.Generator) -> tuple[float, float]:
    """5 ms and more, with a long tail, each way on its own."""
    return 5e-3 + rng.exponential(8e-3), 5e-3 + rng.exponential(8e-3)


class Simulation:
    """A device whose clock is off by `offset_s` and runs at 1 + drift."""

    def __init__(self, delay: Delay, drift: float, offset_s: float = 1234.5, seed: int = 1) -> None:
        self.clock = DeviceClock()
        self.rng = np.random.default_rng(seed)
        self.delay, self.drift, self.offset_s = delay, drift, offset_s
        self.t_s = 50_000.0

    def device_us(self, t_host_s: float) -> int:
        return round((t_host_s * (1 + self.drift) + self.offset_s) * 1e6)

    def run(self, seconds: float, ping_s: float = 0.25) -> None:
        end_s = self.t_s + seconds
        while self.t_s < end_s:
            self.t_s += ping_s * self.rng.uniform(0.5, 1.5)
            there_s, back_s = self.delay(self.rng)
            t1_s, t2_s = self.t_s, self.t_s + there_s
            t4_s = t2_s + 40e-6 + back_s
            t2_us = self.clock.extend(self.device_us(t2_s) % WRAP_US, t4_s)
            self.clock.add_exchange(t1_s, t2_us, t2_us + 40, t4_s)

    def error_s(self, t_host_s: float) -> float:
        t_device_us = self.clock.extend(self.device_us(t_host_s) % WRAP_US, t_host_s)
        return self.clock.t_host_s(t_device_us) - t_host_s


@pytest.mark.parametrize("drift", [0.0, 50e-6, -200e-6, 0.01])
@pytest.mark.parametrize(("delay", "tolerance_s"), [(cable, 50e-6), (bluetooth, 2e-3)])
def test_host_time_is_found_through_drift_and_jitter(delay: Delay, tolerance_s: float, drift: float) -> None:
    simulation = Simulation(delay, drift)
    simulation.run(40.0)
    errors_s = [simulation.error_s(simulation.t_s + ahead_s) for ahead_s in (-1.0, 0.0, 0.5)]
    assert np.abs(errors_s).max() < tolerance_s
    assert simulation.clock.drift_ppm == pytest.approx(
        (1 / (1 + drift) - 1) * 1e6, abs=5 if delay is cable else 150
    )


def test_a_burst_of_pings_is_enough_to_begin() -> None:
    simulation = Simulation(cable, 50e-6)
    simulation.run(0.4, ping_s=0.02)
    assert abs(simulation.error_s(simulation.t_s + 0.5)) < 200e-6


def test_a_prior_of_the_drift_counts_less_the_longer_it_is_watched() -> None:
    simulation = Simulation(cable, 50e-6)
    simulation.clock.sigma_drift = 1e-9
    simulation.run(0.4, ping_s=0.02)
    assert abs(simulation.clock.drift_ppm) < 1
    simulation.clock.sigma_drift = 1e-4
    simulation.run(40)
    assert simulation.clock.drift_ppm == pytest.approx(-50, abs=2)


def test_outliers_that_lie_about_their_round_trip_do_not_move_the_estimate() -> None:
    simulation = Simulation(cable, 20e-6)
    for _ in range(20):
        simulation.run(1.0)
        t1_s = simulation.t_s + 0.01
        lie_us = simulation.device_us(t1_s) + 20_000
        simulation.clock.add_exchange(t1_s, lie_us, lie_us, t1_s + 100e-6)
    assert abs(simulation.error_s(simulation.t_s)) < 100e-6


def test_the_device_clock_wraps_without_a_trace() -> None:
    simulation = Simulation(cable, 0.0, offset_s=-50_000 + (WRAP_US - 5_000_000) * 1e-6)
    simulation.run(2.0)
    before_us = simulation.clock.extend(simulation.device_us(simulation.t_s) % WRAP_US, simulation.t_s)
    simulation.run(8.0)
    after_us = simulation.clock.extend(simulation.device_us(simulation.t_s) % WRAP_US, simulation.t_s)
    assert after_us > WRAP_US > before_us
    assert abs(simulation.error_s(simulation.t_s)) < 50e-6
    assert simulation.clock.restarts == 0


def test_a_silence_longer_than_a_wrap_is_bridged() -> None:
    simulation = Simulation(cable, 0.0)
    simulation.run(40.0)
    simulation.t_s += 1.7 * WRAP_US * 1e-6
    assert abs(simulation.error_s(simulation.t_s)) < 0.1  # 2 hours of a drift that is known to 10 ppm


def test_a_clock_that_was_set_anew_is_followed_after_a_few_pings() -> None:
    simulation = Simulation(cable, 0.0)
    simulation.run(10.0)
    simulation.offset_s = -simulation.t_s
    simulation.run(0.25 * STEP_EXCHANGES * 2)
    assert simulation.clock.restarts == 1
    assert abs(simulation.error_s(simulation.t_s)) < 200e-6


def test_one_absurd_pong_changes_nothing() -> None:
    simulation = Simulation(cable, 0.0)
    simulation.run(10.0)
    t_s = simulation.t_s
    wrong_us = simulation.device_us(t_s) - 900_000_000
    assert not simulation.clock.add_exchange(t_s, wrong_us, wrong_us + 40, t_s + 100e-6)
    assert simulation.clock.restarts == 0
    assert abs(simulation.error_s(t_s)) < 50e-6


def test_impossible_exchanges_are_refused() -> None:
    clock = DeviceClock()
    assert not clock.add_exchange(10.0, 500, 400, 10.1)
    assert not clock.add_exchange(10.0, 0, 200_000, 10.1)
    assert not clock.add_exchange(10.1, 0, 10, 10.0)
    assert not clock.synced
    assert math.isnan(clock.t_host_s(0))
    assert math.isnan(clock.t_device_us(0.0))


def test_memory_of_exchanges_is_bounded() -> None:
    simulation = Simulation(cable, 0.0)
    simulation.run(2 * WINDOW * 0.25)
    assert len(simulation.clock._exchanges) == WINDOW


@given(st.integers(0, WRAP_US - 1), st.integers(-(2**50), 2**50))
def test_the_extension_is_congruent_and_nearest(t_us: int, near_us: int) -> None:
    extended_us = extend_us(t_us, near_us)
    assert extended_us % WRAP_US == t_us
    assert abs(extended_us - near_us) <= WRAP_US // 2
