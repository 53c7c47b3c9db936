"""Calibration records: what is taken into use, what is refused, and what they do to a reading."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from firmware.c_arrays import floats
from firmware.calibration_records import SLOTS, record
from ribbonhil._firmware import ffi, lib
from ribbonhost.framing import crc32
from ribbonhost.wire import Calibration

SIZE: int = lib.CALIBRATION_RECORD_BYTES
FIELDS_AT = {
    "layout": 0,
    "mag_axes": 2,
    "slot_count": 3,
    "pitch_m": 8,
    "horizontal": 12,
    "down": 16,
    "slots": 20,
}


def new():
    calibration = ffi.new("struct calibration *")
    lib.calibration_init(calibration)
    return calibration


def in_use(calibration) -> bytes:
    return bytes(ffi.buffer(calibration.record))


def test_uncalibrated_device_has_the_identity():
    calibration = new()
    values = Calibration.unpack(in_use(calibration))
    assert values.layout == 1
    assert values.mag_axes == 2
    assert values.created_s == 0
    assert len(values.slots) == SLOTS
    assert np.array_equal(values.slots.offset, np.zeros((SLOTS, 3)))
    assert np.array_equal(values.slots.matrix, np.tile(np.eye(3).ravel(), (SLOTS, 1)))
    assert calibration.sequence == 0
    assert calibration.crc32 == crc32(in_use(calibration))


def test_record_is_taken_into_use_byte_for_byte():
    calibration = new()
    wanted = record(1)
    assert len(wanted) == SIZE
    assert lib.calibration_use(calibration, wanted, 7)
    assert in_use(calibration) == wanted
    assert (calibration.sequence, calibration.crc32) == (7, crc32(wanted))
    assert calibration.values.pitch_m == pytest.approx(0.025)


@pytest.mark.parametrize(
    ("at", "replacement"),
    [
        (FIELDS_AT["layout"], b"\x02\x00"),
        (FIELDS_AT["mag_axes"], b"\x01"),
        (FIELDS_AT["mag_axes"], b"\x04"),
        (FIELDS_AT["slot_count"], bytes([SLOTS - 1])),
        (FIELDS_AT["slot_count"], bytes([SLOTS + 1])),
        (FIELDS_AT["slot_count"], b"\xff"),
        *[(FIELDS_AT["pitch_m"], struct.pack("<f", x)) for x in (0.0, 0.0009, 1.1, np.nan, np.inf)],
        *[(FIELDS_AT["horizontal"], struct.pack("<f", x)) for x in (0.9, 100.5, -20.0, np.nan)],
        *[(FIELDS_AT["down"], struct.pack("<f", x)) for x in (100.5, -100.5, np.nan)],
        *[(FIELDS_AT["slots"] + 4 * i, struct.pack("<f", np.nan)) for i in (0, 11, 12)],
        (SIZE - 4, struct.pack("<f", -np.inf)),
    ],
)
def test_record_that_cannot_be_used_changes_nothing(at, replacement):
    calibration = new()
    assert lib.calibration_use(calibration, record(2), 3)
    before = bytes(ffi.buffer(calibration))
    bad = record(3)[:at] + replacement + record(3)[at + len(replacement) :]
    assert not lib.calibration_accepts(calibration, bad)
    assert not lib.calibration_use(calibration, bad, 4)
    assert bytes(ffi.buffer(calibration)) == before


def test_accepting_is_only_looking():
    calibration = new()
    before = bytes(ffi.buffer(calibration))
    assert lib.calibration_accepts(calibration, record(4))
    assert bytes(ffi.buffer(calibration)) == before


@pytest.mark.parametrize(
    "edge", [{"pitch_m": 1.0}, {"field_horizontal_ut": 100.0}, {"field_down_ut": -100.0}]
)
def test_limits_themselves_are_in_range(edge):
    assert lib.calibration_use(new(), record(5, **edge), 1)


def test_calibration_is_matrix_times_reading_less_offset():
    """Within 1e-5 of double precision."""
    rng = np.random.default_rng(6)
    slot = ffi.new("struct wire_slot_calibration *")
    for _ in range(100):
        offset, matrix, reading = rng.normal(size=3), rng.normal(size=(3, 3)), 10 * rng.normal(size=3)
        slot.offset, slot.matrix = offset.tolist(), matrix.ravel().tolist()
        out = ffi.new("float[3]")
        lib.calibration_apply(slot, floats(reading), out)
        assert list(out) == pytest.approx(matrix @ (reading - offset), abs=2e-5)
