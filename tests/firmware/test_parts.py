"""What the sensor parts are set to, at every rate."""

from __future__ import annotations

import pytest
from ribbonhil._firmware import ffi, lib

LIS2DW12, MMC5983MA, HMC5983 = 0, 1, 2
ODR_HZ = (0, 12.5, 12.5, 25, 50, 100, 200, 400, 800, 1600)
RATES = tuple(range(1, 201))


def configured(part: int, rate_hz: int):
    config = ffi.new("struct part_config *")
    lib.part_configure(lib.PARTS[part], rate_hz, config)
    return config


def test_every_part_has_an_identity_and_fits_the_buffers_of_a_slot():
    identities = set()
    for part in lib.PARTS:
        assert 1 <= part.identity_count <= lib.PART_ID_MAX
        assert 1 <= part.config_count <= lib.PART_CONFIG_MAX
        assert 1 <= part.burst_count <= lib.PART_BURST_MAX
        identities.add(bytes(part.identity)[: part.identity_count])
    assert identities == {b"\x44", b"\x30", b"H43"}


@pytest.mark.parametrize("rate_hz", RATES)
def test_lis2dw12_samples_eight_times_a_scan_with_its_i2c_off(rate_hz):
    config = configured(LIS2DW12, rate_hz)
    ctrl1, ctrl2, ctrl6 = config.registers[0], config.registers[1], config.registers[5]
    odr_hz = ODR_HZ[ctrl1 >> 4]
    assert odr_hz >= 8 * rate_hz
    assert config.sample_hz == pytest.approx(odr_hz)
    assert ctrl1 & 0x0F == 0x04, "high performance, 14 bit"
    assert ctrl2 == 0x0E, "BDU, address increment, I2C off"
    assert ctrl6 & 0x34 == 0x04, "2 g, low noise"
    bandwidth_hz = odr_hz / (2, 4, 10, 20)[ctrl6 >> 6]
    assert 20 <= bandwidth_hz <= max(25, 0.8 * rate_hz)
    assert config.noise == pytest.approx(90e-6 * bandwidth_hz**0.5 * 9.80665, rel=1e-5)
    assert config.lsb == pytest.approx(0.244e-3 * 9.80665, rel=1e-6)


@pytest.mark.parametrize("rate_hz", RATES)
def test_mmc5983ma_measures_within_half_a_period(rate_hz):
    config = configured(MMC5983MA, rate_hz)
    bandwidth = config.registers[0]
    typical_us = (8000, 4000, 2000, 500)[bandwidth]
    assert typical_us <= 0.5e6 / rate_hz
    assert bandwidth == 0 or (8000, 4000, 2000, 500)[bandwidth - 1] > 0.5e6 / rate_hz, "the longest that fits"
    assert config.measurement_us >= 1.1 * typical_us
    assert config.noise == pytest.approx(0.1 * (0.4, 0.6, 0.8, 1.2)[bandwidth])
    assert config.lsb == pytest.approx(100 / 16384)


@pytest.mark.parametrize("rate_hz", RATES)
def test_hmc5983_measures_singly_as_long_as_that_fits_a_period(rate_hz):
    config = configured(HMC5983, rate_hz)
    assert bytes(config.registers)[:2] == b"\x9c\x20"
    if config.measurement_us:
        assert config.registers[2] & 3 == 2, "idle until triggered"
        assert config.measurement_us >= 4500
        assert config.measurement_us + 1000 < 1e6 / rate_hz
    else:
        assert config.registers[2] & 3 == 0, "continuous"
        assert config.sample_hz >= rate_hz
    assert config.lsb == pytest.approx(100 / 1090)
