"""Bursts of the sensor parts to counts, on bytes taken from the data sheets."""

from __future__ import annotations

import numpy as np
import pytest
from ribbonhil._firmware import ffi, lib

LIS2DW12, MMC5983MA, HMC5983 = 0, 1, 2


def decode(part: int, burst: bytes):
    sample = ffi.new("struct part_sample *")
    assert len(burst) == lib.PARTS[part].burst_count
    lib.part_decode(lib.PARTS[part], burst, sample)
    return sample


def lis2dw12_burst(counts, status: int = 1) -> bytes:
    words = (np.asarray(counts) * 4).astype("<i2")
    return bytes([status]) + words.tobytes()


def mmc5983ma_burst(counts, status: int = 0x11) -> bytes:
    raw = [int(count) + 131072 for count in counts]
    high = [byte for value in raw for byte in (value >> 10, (value >> 2) & 0xFF)]
    low = sum((value & 3) << shift for value, shift in zip(raw, (6, 4, 2), strict=True))
    return bytes([*high, low, 0x80, status])


def hmc5983_burst(counts, mode: int = 3, config: bytes = b"\x9c\x20") -> bytes:
    x, y, z = counts
    return config + bytes([mode]) + np.array([x, z, y]).astype(">i2").tobytes()


@pytest.mark.parametrize(
    ("part", "burst", "counts"),
    [
        # LIS2DW12: 1 g at 2 g full scale is 4098 counts of 0.244 mg, left-justified 0x4008.
        (LIS2DW12, bytes([0x01, 0x00, 0x00, 0xFC, 0xFF, 0x08, 0x40]), (0, -1, 4098)),
        # MMC5983MA: null field 131072 = 0x20000; 0.5 G is 8192 counts.
        (MMC5983MA, bytes([0x80, 0, 0x88, 0, 0x77, 0xFF, 0b00001100, 0, 1]), (0, 8192, -8193)),
        # HMC5983: X, Z, Y, high byte first.
        (HMC5983, bytes([0x9C, 0x20, 0x03, 0x01, 0x00, 0xFF, 0xFE, 0x00, 0x7F]), (256, 127, -2)),
    ],
)
def test_bytes_of_the_data_sheet_give_its_counts(part, burst, counts):
    assert tuple(decode(part, burst).counts) == counts


@pytest.mark.parametrize(
    ("part", "burst_of", "limit"),
    [(LIS2DW12, lis2dw12_burst, 8190), (MMC5983MA, mmc5983ma_burst, 131070), (HMC5983, hmc5983_burst, 2046)],
)
def test_every_count_comes_back(part, burst_of, limit):
    rng = np.random.default_rng(part)
    edges = [(-limit, limit, 0), (1, -1, 2), (3, -3, -2)]
    for counts in [*edges, *rng.integers(-limit, limit + 1, (500, 3)).tolist()]:
        sample = decode(part, burst_of(counts))
        assert list(sample.counts) == list(counts)
        assert sample.is_new
        assert sample.is_configured
        assert not sample.is_saturated


@pytest.mark.parametrize(
    ("part", "burst"),
    [
        (LIS2DW12, lis2dw12_burst((1, 2, 3), status=0x20)),
        (MMC5983MA, mmc5983ma_burst((1, 2, 3), status=0x10)),
        (HMC5983, hmc5983_burst((1, 2, 3), mode=1)),
    ],
)
def test_sample_that_was_read_before_is_not_new(part, burst):
    assert not decode(part, burst).is_new


@pytest.mark.parametrize(
    ("part", "burst"),
    [
        (LIS2DW12, lis2dw12_burst((0, 8191, 0))),
        (LIS2DW12, lis2dw12_burst((-8192, 0, 0))),
        (MMC5983MA, mmc5983ma_burst((0, 0, 131071))),
        (MMC5983MA, mmc5983ma_burst((0, -131072, 0))),
        (HMC5983, hmc5983_burst((0, 0, -4096))),
    ],
)
def test_axis_at_the_end_of_its_range_is_saturated(part, burst):
    assert decode(part, burst).is_saturated


def test_hmc5983_that_fell_to_its_defaults_says_so():
    assert not decode(HMC5983, hmc5983_burst((1, 2, 3), config=b"\x10\x20")).is_configured


def test_any_bytes_decode_to_counts_in_range():
    rng = np.random.default_rng(7)
    limits = {LIS2DW12: 8192, MMC5983MA: 131072, HMC5983: 32768}
    for part, limit in limits.items():
        for burst in rng.integers(0, 256, (300, lib.PARTS[part].burst_count), dtype=np.uint8):
            assert all(-limit <= count < limit for count in decode(part, burst.tobytes()).counts)
