"""The LIS2DW12 model behaves on the bus as the part's data sheet says."""

import numpy as np
import pytest
from hil.string_bench import LIS2DW12, MS, StringBench

CTRL1, CTRL2, CTRL6 = 0x20, 0x21, 0x25
STATUS, OUT_X_L, OUT_X_H, WHO_AM_I = 0x27, 0x28, 0x29, 0x0F
HIGH_PERFORMANCE = 0x04
ODR_100, ODR_200, ODR_400 = 0x50, 0x60, 0x70
BDU_ADVANCE = 0x0C
LOW_NOISE = 0x04
MG_PER_COUNT = 0.244
G = 9.80665


def powered(**world: object) -> StringBench:
    """One part, 25 ms after power-up."""
    bench = StringBench(LIS2DW12, **world)
    bench.wait(0.025)
    return bench


def running(rate: int = ODR_400, filter_and_range: int = LOW_NOISE, **world: object) -> StringBench:
    bench = powered(**world)
    bench.write(0, CTRL6, filter_and_range)
    bench.write(0, CTRL2, BDU_ADVANCE)
    bench.write(0, CTRL1, rate | HIGH_PERFORMANCE)
    return bench


def counts(bench: StringBench) -> np.ndarray:
    """x, y, z of the output registers, right-justified."""
    return np.frombuffer(bench.read(0, OUT_X_L, 6), "<i2").astype(int) >> 2


def samples(bench: StringBench, number: int) -> np.ndarray:
    """(number, 3) counts of samples in a row, each read as soon as it is ready."""
    taken = []
    while len(taken) < number:
        if bench.read(0, STATUS)[0] & 1:
            taken.append(counts(bench))
        bench.wait(100e-6)
    return np.array(taken)


def test_registers_hold_their_reset_values_after_power_up():
    bench = powered()
    assert bench.read(0, WHO_AM_I) == b"\x44"
    assert bench.read(0, CTRL1, 6) == bytes([0x00, 0x04, 0x00, 0x00, 0x00, 0x00])
    assert bench.read(0, STATUS) == b"\x00"
    assert bench.rejected(0) == {}


def test_part_answers_only_after_its_boot_time():
    bench = StringBench(LIS2DW12)
    bench.wait(0.019)
    assert bench.read(0, WHO_AM_I) == b"\xff"
    bench.wait(0.001)
    assert bench.read(0, WHO_AM_I) == b"\x44"
    assert bench.rejected(0) == {"premature": 1}


def test_address_advances_only_while_told_to():
    bench = powered()
    assert bench.read(0, CTRL1, 2) == bytes([0x00, 0x04])
    bench.write(0, CTRL2, 0x00)
    bench.write(0, CTRL1, 0x54)
    assert bench.read(0, CTRL1, 3) == bytes([0x54] * 3)


def test_read_only_and_reserved_registers_refuse_writes_and_count_them():
    bench = powered()
    bench.write(0, WHO_AM_I, 0x12)
    bench.write(0, 0x05, 0x12)
    assert bench.read(0, WHO_AM_I) == b"\x44"
    assert bench.rejected(0) == {"read_only": 1, "address": 1}


@pytest.mark.parametrize(
    ("address", "value", "reason"),
    [
        (CTRL1, 0xA4, "value"),
        (CTRL1, 0x50, "not_modelled"),
        (0x22, 0x40, "not_modelled"),
        (0x2E, 0xC0, "not_modelled"),
    ],
    ids=["reserved rate", "low power", "self-test", "fifo"],
)
def test_what_the_part_or_model_cannot_do_is_counted(address: int, value: int, reason: str):
    bench = powered()
    bench.write(0, address, value)
    assert bench.rejected(0) == {reason: 1}


def test_command_without_data_is_counted():
    bench = powered()
    bench.transaction(0, b"\x8f")
    assert bench.rejected(0) == {"truncated": 1}


def test_soft_reset_restores_the_defaults():
    bench = running()
    bench.write(0, CTRL2, 0x40)
    bench.wait(200e-6)
    assert bench.read(0, CTRL1, 6) == bytes([0x00, 0x04, 0x00, 0x00, 0x00, 0x00])


@pytest.mark.parametrize(("rate", "hertz"), [(ODR_100, 100), (ODR_200, 200), (ODR_400, 400)])
def test_samples_come_at_the_parts_own_rate(rate: int, hertz: int):
    rates = []
    for seed in range(10):
        bench = running(rate, seed=seed)
        ready = []
        while len(ready) < 12:
            if bench.read(0, STATUS)[0] & 1:
                ready.append(bench.t_ns)
                counts(bench)
            bench.wait(20e-6)
        rates.append(1e9 / np.diff(ready).mean())
    assert (
        np.abs(np.array(rates) / hertz - 1).max() <= 0.112
    )  # 10 % tolerance of the oscillator, plus polling
    assert np.std(rates) / hertz > 0.02


def test_data_ready_falls_when_a_high_byte_is_read_and_rises_with_the_next_sample():
    bench = running(ODR_100)
    assert bench.read(0, STATUS) == b"\x00"
    bench.wait(0.025)
    assert bench.read(0, STATUS) == b"\x01"
    bench.read(0, OUT_X_L)
    assert bench.read(0, STATUS) == b"\x01"
    bench.read(0, OUT_X_H)
    assert bench.read(0, STATUS) == b"\x00"
    bench.wait(0.012)
    assert bench.read(0, STATUS) == b"\x01"


def test_block_data_update_keeps_both_bytes_of_an_axis_from_one_sample():
    ramp = np.linspace(0, 19.0, 40)[:, None] * np.ones(3)
    bench = running(specific_force_mps2=ramp, step_s=0.05)
    torn = {0: 0, BDU_ADVANCE: 0}
    for ctrl2 in torn:
        bench.write(0, CTRL2, ctrl2 | 0x04)
        for _ in range(80):
            low = bench.read(0, OUT_X_L)
            bench.wait(0.003)
            high = bench.read(0, OUT_X_H)
            bench.wait(0.003)
            value = int.from_bytes(low + high, "little", signed=True) / 4
            expected = (
                np.interp((bench.t_ns / MS - 6) / 50, np.arange(40), ramp[:, 0]) / G * 1e3 / MG_PER_COUNT
            )
            torn[ctrl2] += abs(value - expected) > 40
    assert torn[BDU_ADVANCE] == 0
    assert torn[0] > 10


@pytest.mark.parametrize("code", range(4), ids=["2g", "4g", "8g", "16g"])
def test_counts_are_the_specific_force_in_the_chosen_range(code: int):
    force = np.array([1.0, -2.0, 9.80665])
    bench = running(filter_and_range=code << 4, specific_force_mps2=force)
    bench.wait(0.05)
    lsb_mps2 = MG_PER_COUNT * 2**code * 1e-3 * G
    np.testing.assert_allclose(counts(bench) * lsb_mps2, force, atol=0.51 * lsb_mps2)


def test_an_axis_beyond_the_range_saturates():
    bench = running(specific_force_mps2=(30.0, -30.0, 0.0))
    bench.wait(0.05)
    assert counts(bench).tolist() == [8191, -8192, 0]


@pytest.mark.parametrize(
    ("rate", "hertz", "filter_code", "divisor"),
    [(ODR_400, 400, 0, 2), (ODR_400, 400, 1, 4), (ODR_200, 200, 2, 10)],
)
def test_noise_is_the_density_times_the_root_of_the_bandwidth(
    rate: int, hertz: int, filter_code: int, divisor: int
):
    bench = running(rate, filter_code << 6 | LOW_NOISE, noise=1.0)
    taken = samples(bench, 1500)
    expected_mg = 90e-3 * np.sqrt(hertz / divisor)
    # 5 % for the oscillator's error, 8 % for the statistics of correlated samples.
    np.testing.assert_allclose(taken.std(axis=0) * MG_PER_COUNT, expected_mg, rtol=0.13)


def test_temperature_registers_follow_the_temperature():
    bench = powered(temperature_c=31.5)
    assert int.from_bytes(bench.read(0, 0x0D, 2), "little", signed=True) / 256 == pytest.approx(6.5)
    assert bench.read(0, 0x26) == bytes([6])


def test_noise_of_a_sample_does_not_depend_on_when_it_is_read():
    often, rarely = running(noise=1.0, seed=5), running(noise=1.0, seed=5)
    for _ in range(30):
        often.wait(0.001)
        samples(often, 1)
    rarely.t_ns = often.t_ns
    often.bus.sensors[0].state.lis2dw12.data_ready = False
    np.testing.assert_array_equal(counts(often), counts(rarely))
