"""The MMC5983MA model behaves on the bus as the part's data sheet says."""

import numpy as np
import pytest
from hil.string_bench import MMC5983MA, StringBench

STATUS, CONTROL0, CONTROL1, CONTROL2, PRODUCT_ID = 0x08, 0x09, 0x0A, 0x0B, 0x2F
TM_M, TM_T, SET, RESET, AUTO_SR = 0x01, 0x02, 0x08, 0x10, 0x20
M_DONE, T_DONE, OTP_DONE = 0x01, 0x02, 0x10
UT_PER_COUNT = 100 / 16384
NULL = 131072
FIELD_UT = np.array([12.0, -21.0, -37.0])


def powered(field_ut: object = FIELD_UT, **world: object) -> StringBench:
    """One part, 15 ms after power-up."""
    bench = StringBench(MMC5983MA, field_ut=field_ut, **world)
    bench.wait(0.015)
    return bench


def outputs(bench: StringBench) -> np.ndarray:
    """x, y, z as 18-bit counts."""
    burst = bench.read(0, 0x00, 7)
    return np.array(
        [burst[2 * i] << 10 | burst[2 * i + 1] << 2 | burst[6] >> (6 - 2 * i) & 3 for i in range(3)]
    )


def measured(bench: StringBench, pulse: int, bandwidth: int = 0) -> np.ndarray:
    """Counts of one measurement after a SET or RESET."""
    bench.write(0, CONTROL1, bandwidth)
    bench.write(0, CONTROL0, pulse)
    bench.wait(2e-6)
    bench.write(0, CONTROL0, TM_M)
    bench.wait(0.009)
    assert bench.read(0, STATUS)[0] & M_DONE
    return outputs(bench)


def test_identity_and_status_after_power_up():
    bench = powered()
    assert bench.read(0, PRODUCT_ID) == b"\x30"
    assert bench.read(0, STATUS) == bytes([OTP_DONE])
    assert bench.rejected(0) == {}


def test_part_answers_only_after_its_power_up_time():
    bench = StringBench(MMC5983MA)
    bench.wait(0.009)
    assert bench.read(0, PRODUCT_ID) == b"\xff"
    bench.wait(0.002)
    assert bench.read(0, PRODUCT_ID) == b"\x30"
    assert bench.rejected(0) == {"premature": 1}


def test_control_registers_cannot_be_read():
    bench = powered()
    bench.write(0, CONTROL1, 0x03)
    assert bench.read(0, CONTROL0, 4) == bytes(4)
    assert bench.rejected(0) == {"write_only": 4}


def test_set_and_reset_measurements_differ_by_twice_the_field_and_share_the_offset():
    offsets = []
    for seed in range(30):
        bench = powered(seed=seed)
        plus, minus = measured(bench, SET), measured(bench, RESET)
        np.testing.assert_allclose((plus - minus) / 2 * UT_PER_COUNT, FIELD_UT, atol=UT_PER_COUNT)
        offsets.append(((plus + minus) / 2 - NULL) * UT_PER_COUNT)
    assert np.abs(offsets).max() <= 50.0  # uT: +-0.5 G
    assert np.std(offsets) > 20.0


def test_polarity_after_power_up_is_not_known():
    signs = set()
    for seed in range(12):
        bench = powered(seed=seed)
        unknown = measured(bench, 0)
        signs.add(np.array_equal(unknown, measured(bench, SET)))
    assert signs == {True, False}


def test_automatic_set_ends_a_reset_polarity():
    bench = powered()
    plus = measured(bench, SET)
    measured(bench, RESET)
    np.testing.assert_array_equal(
        measured(bench, AUTO_SR), measured(bench, RESET)
    )  # TM_M alone turned it off
    bench.write(0, CONTROL0, AUTO_SR | TM_M)
    bench.wait(0.009)
    np.testing.assert_array_equal(outputs(bench), plus)


@pytest.mark.parametrize(("bandwidth", "ms"), [(0, 8), (1, 4), (2, 2), (3, 0.5)])
def test_measurement_is_done_after_its_time(bandwidth: int, ms: float):
    bench = powered()
    bench.write(0, CONTROL1, bandwidth)
    bench.write(0, CONTROL0, TM_M)
    bench.wait(0.94 * ms * 1e-3 - 50e-6)
    assert bench.read(0, STATUS)[0] & M_DONE == 0
    bench.wait(0.12 * ms * 1e-3 + 50e-6)
    assert bench.read(0, STATUS)[0] & M_DONE


def test_a_new_measurement_clears_done_and_keeps_the_old_output_until_it_ends():
    bench = powered(field_ut=np.linspace(0, 40, 60)[:, None] * np.ones(3), step_s=0.01)
    first = measured(bench, SET)
    bench.wait(0.1)
    bench.write(0, CONTROL0, TM_M)
    assert bench.read(0, STATUS)[0] & M_DONE == 0
    np.testing.assert_array_equal(outputs(bench), first)
    bench.wait(0.009)
    assert (outputs(bench) > first + 100).all()


@pytest.mark.parametrize(("bandwidth", "milligauss"), [(0, 0.4), (1, 0.6), (2, 0.8), (3, 1.2)])
def test_noise_is_that_of_the_bandwidth(bandwidth: int, milligauss: float):
    bench = powered(noise=1.0)
    taken = np.array([measured(bench, SET, bandwidth) for _ in range(400)])
    np.testing.assert_allclose(taken.std(axis=0) * UT_PER_COUNT, milligauss * 0.1, rtol=0.13)


def test_field_beyond_the_range_saturates():
    bench = powered(field_ut=(900.0, -900.0, 0.0))
    assert measured(bench, SET)[:2].tolist() == [262143, 0]


def test_continuous_mode_measures_at_its_rate_and_shows_when_it_is_busy():
    bench = powered()
    bench.write(0, CONTROL2, 0x08 | 0x04)  # 50 Hz, measurements of 8 ms
    status = []
    for _ in range(10000):
        status.append(bench.read(0, STATUS)[0] & M_DONE)
        bench.t_ns += 100_000 - 3_200
    rising = np.flatnonzero(np.diff(status) == 1)
    assert 1e4 / np.diff(rising).mean() == pytest.approx(50, rel=0.06)
    assert np.mean(status) == pytest.approx(0.6, abs=0.05)


def test_continuous_mode_faster_than_its_measurement_is_refused():
    bench = powered()
    bench.write(0, CONTROL2, 0x08 | 0x07)
    bench.wait(0.1)
    assert bench.rejected(0) == {"value": 1}
    assert bench.bus.sensors[0].counters.samples == 0


@pytest.mark.parametrize(
    ("address", "value", "reason"),
    [
        (CONTROL0, SET | RESET, "value"),
        (CONTROL0, TM_M | TM_T, "value"),
        (CONTROL1, 0x04, "not_modelled"),
        (0x0C, 0x40, "not_modelled"),
        (0x03, 0x00, "read_only"),
        (0x15, 0x00, "address"),
    ],
)
def test_impossible_writes_are_counted(address: int, value: int, reason: str):
    bench = powered()
    bench.write(0, address, value)
    assert bench.rejected(0) == {reason: 1}


def test_commands_during_a_measurement_are_refused():
    bench = powered()
    undisturbed = measured(bench, SET)
    bench.write(0, CONTROL0, TM_M)
    bench.write(0, CONTROL0, RESET)
    bench.write(0, CONTROL0, TM_M)
    bench.wait(0.009)
    np.testing.assert_array_equal(outputs(bench), undisturbed)
    assert bench.rejected(0) == {"busy": 2}


def test_temperature_is_measured_on_demand():
    bench = powered(temperature_c=25.0)
    assert bench.read(0, 0x07) == b"\x00"
    bench.write(0, CONTROL0, TM_T)
    bench.wait(0.009)
    assert bench.read(0, STATUS)[0] & T_DONE
    assert bench.read(0, 0x07)[0] * 0.8 - 75 == pytest.approx(25.0, abs=0.4)


def test_software_reset_takes_the_power_up_time_and_keeps_the_polarity():
    bench = powered()
    minus = measured(bench, RESET)
    bench.write(0, CONTROL1, 0x80)
    assert bench.read(0, PRODUCT_ID) == b"\xff"
    bench.wait(0.011)
    assert bench.read(0, STATUS) == bytes([OTP_DONE])
    np.testing.assert_array_equal(measured(bench, 0), minus)
