"""The HMC5983 model behaves on the bus as the part's data sheet says."""

import numpy as np
import pytest
from hil.string_bench import HMC5983, StringBench

CONFIG_A, CONFIG_B, MODE, OUT, STATUS, ID_A, TEMPERATURE = 0x00, 0x01, 0x02, 0x03, 0x09, 0x0A, 0x31
ADVANCE = 0x40
CONTINUOUS, SINGLE = 0x00, 0x01
RDY, LOCK, DOW = 0x01, 0x02, 0x10
FIELD_UT = np.array([30.0, -18.0, 41.0])
COUNTS_PER_UT = 10.9


def powered(field_ut: object = FIELD_UT, **world: object) -> StringBench:
    bench = StringBench(HMC5983, field_ut=field_ut, **world)
    bench.wait(0.015)
    return bench


def outputs(bench: StringBench) -> np.ndarray:
    """x, y, z counts."""
    x, z, y = np.frombuffer(bench.read(0, ADVANCE | OUT, 6), ">i2").astype(int)
    return np.array([x, y, z])


def single(bench: StringBench) -> np.ndarray:
    bench.write(0, MODE, SINGLE)
    bench.wait(0.005)
    assert bench.read(0, STATUS)[0] & RDY
    return outputs(bench)


def test_registers_hold_their_reset_values_after_power_up():
    bench = powered()
    assert bench.read(0, ADVANCE | CONFIG_A, 3) == b"\x10\x20\x01"
    assert bench.read(0, ADVANCE | ID_A, 3) == b"H43"
    assert bench.rejected(0) == {}


def test_address_advances_only_with_the_increment_bit_and_goes_round_the_outputs():
    bench = powered()
    first = single(bench)
    assert bench.read(0, CONFIG_A, 3) == b"\x10\x10\x10"
    twice = np.frombuffer(bench.read(0, ADVANCE | OUT, 12), ">i2")
    np.testing.assert_array_equal(twice[:3], twice[3:])
    assert twice[0] == first[0]


def test_single_measurement_is_the_field_in_the_order_x_z_y():
    bench = powered()
    np.testing.assert_allclose(single(bench), FIELD_UT * COUNTS_PER_UT, atol=0.51)
    assert bench.read(0, MODE)[0] & 0x03 == 0x02


def test_gain_scales_and_overflow_reads_its_own_value():
    bench = powered(field_ut=(100.0, 20.0, -600.0))
    bench.write(0, CONFIG_B, 7 << 5)
    np.testing.assert_allclose(single(bench), np.array([100.0, 20.0, -600.0]) * 2.3, atol=0.51)
    bench.write(0, CONFIG_B, 0)
    assert single(bench).tolist() == [1370, 274, -4096]


def test_half_read_outputs_are_locked_until_all_are_read():
    bench = powered(field_ut=np.linspace(0, 100, 100)[:, None] * np.ones(3), step_s=0.01)
    bench.write(0, CONFIG_A, 0x18)
    bench.write(0, MODE, CONTINUOUS)
    bench.wait(0.04)
    bench.read(0, OUT)
    assert bench.read(0, STATUS)[0] & LOCK
    before = bench.read(0, OUT + 1)
    bench.wait(0.3)
    assert bench.read(0, OUT + 1) == before
    outputs(bench)
    assert bench.read(0, STATUS)[0] & LOCK == 0
    bench.wait(0.05)
    assert bench.read(0, OUT + 1) != before


def test_continuous_mode_delivers_at_its_rate_after_two_periods():
    bench = powered()
    bench.write(0, CONFIG_A, 0x18)
    start_ns = bench.t_ns
    bench.write(0, MODE, CONTINUOUS)
    ready_ns = []
    while len(ready_ns) < 20:
        if bench.read(0, STATUS)[0] & RDY:
            ready_ns.append(bench.t_ns)
            outputs(bench)
        bench.wait(100e-6)
    assert 1e9 / np.diff(ready_ns).mean() == pytest.approx(75, rel=0.06)
    assert (ready_ns[0] - start_ns) * 75e-9 == pytest.approx(2, rel=0.07)


def test_unread_outputs_that_are_overwritten_are_reported():
    bench = powered()
    bench.write(0, MODE, CONTINUOUS)
    bench.wait(0.15)
    assert bench.read(0, STATUS)[0] & DOW == 0
    bench.wait(0.15)
    assert bench.read(0, STATUS)[0] & DOW


@pytest.mark.parametrize(("averaged", "milligauss"), [(0, 2.0), (3, 2.0 / np.sqrt(8))])
def test_noise_falls_with_the_root_of_the_averaged_samples(averaged: int, milligauss: float):
    bench = powered(noise=1.0)
    bench.write(0, CONFIG_A, averaged << 5 | 0x10)
    taken = []
    for _ in range(400):
        bench.write(0, MODE, SINGLE)
        bench.wait(0.04)
        taken.append(outputs(bench))
    quantisation = 1 / np.sqrt(12)
    expected = np.hypot(milligauss * 0.1 * COUNTS_PER_UT, quantisation)
    np.testing.assert_allclose(np.std(taken, axis=0), expected, rtol=0.13)


def test_temperature_reads_only_while_its_sensor_is_on():
    bench = powered(temperature_c=28.5)
    assert bench.read(0, ADVANCE | TEMPERATURE, 2) == b"\x00\x00"
    bench.write(0, CONFIG_A, 0x90)
    value = int.from_bytes(bench.read(0, ADVANCE | TEMPERATURE, 2), "big", signed=True)
    assert value / 128 + 25 == pytest.approx(28.5, abs=0.01)


@pytest.mark.parametrize(
    ("address", "value", "reason"),
    [
        (CONFIG_A, 0x11, "not_modelled"),
        (CONFIG_B, 0x21, "value"),
        (MODE, 0x84, "not_modelled"),
        (OUT, 0, "read_only"),
    ],
)
def test_impossible_writes_are_counted(address: int, value: int, reason: str):
    bench = powered()
    bench.write(0, address, value)
    assert bench.rejected(0) == {reason: 1}
