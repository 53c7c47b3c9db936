"""The calibration over power cuts: each step of a commit leaves the old or the new one, never neither."""

from __future__ import annotations

import numpy as np
import pytest
from firmware.calibration_records import record
from ribbonhil._firmware import ffi, lib

NEVER = 2**64 - 1


class Device:
    """What is left of a device when its power is cut: the board's store. Boots anew each time."""

    def __init__(self) -> None:
        self.board = ffi.new("struct board *")
        lib.host_board_init(self.board)
        self.boot()

    def boot(self) -> None:
        self.board.store_steps_left = NEVER
        self.store = ffi.new("struct calibration_store *")
        self.calibration = ffi.new("struct calibration *")
        lib.calibration_init(self.calibration)
        scratch = ffi.new("uint8_t[]", lib.CALIBRATION_RECORD_BYTES)
        lib.calibration_store_load(self.store, self.board, self.calibration, scratch)

    def commit(self, data: bytes, *, cut_after: int = NEVER) -> bool:
        """Commits a record; the power is cut after so many steps of the store (words, halves of an erase)."""
        self.board.store_steps_left = cut_after
        sequence = (self.calibration.sequence + 1) % 2**32
        stored = lib.calibration_store_save(self.store, self.board, data, sequence)
        if stored:
            lib.calibration_use(self.calibration, data, sequence)
        return stored

    @property
    def in_use(self) -> tuple[bytes, int]:
        return bytes(ffi.buffer(self.calibration.record)), self.calibration.sequence

    def steps_of_a_commit(self, data: bytes) -> int:
        self.board.store_steps_left = 10**6
        assert self.commit(data, cut_after=10**6)
        return 10**6 - self.board.store_steps_left


def test_new_device_has_the_identity():
    device = Device()
    assert device.in_use[1] == 0


def test_committed_calibration_outlives_a_reset():
    device = Device()
    for n in range(1, 6):
        assert device.commit(record(n))
        device.boot()
        assert device.in_use == (record(n), n)


def test_power_cut_at_every_single_step_leaves_old_or_new():
    """For a first commit (old: the identity) and for later ones, at each erase and each word of the write."""
    steps = Device().steps_of_a_commit(record(1))
    assert steps > lib.CALIBRATION_RECORD_BYTES // 4
    outcomes = {"old": 0, "new": 0}
    for earlier in ((), (record(11),), (record(11), record(12))):
        for cut in range(steps + 1):
            device = Device()
            for data in earlier:
                assert device.commit(data)
            old = device.in_use
            committed = device.commit(record(1), cut_after=cut)
            device.boot()
            new = (record(1), old[1] + 1)
            assert device.in_use in (old, new), f"neither old nor new after {cut} steps"
            assert device.in_use == new or not committed, "what was acknowledged is there"
            outcomes["new" if device.in_use == new else "old"] += 1
    assert outcomes["old"] > 1000
    assert outcomes["new"] == 3


def test_two_hundred_random_power_cuts_in_a_row():
    """One device, cut again and again; after each the store still takes a commit."""
    rng = np.random.default_rng(1)
    device = Device()
    steps = device.steps_of_a_commit(record(0))
    for n in range(1, 201):
        old = device.in_use
        committed = device.commit(record(n), cut_after=int(rng.integers(0, steps + 5)))
        device.boot()
        assert device.in_use in (old, (record(n), old[1] + 1))
        assert device.in_use == old or committed or device.in_use[0] == record(n)
    assert device.commit(record(999))
    device.boot()
    assert device.in_use[0] == record(999)


@pytest.mark.parametrize("seed", range(20))
def test_flash_full_of_anything_boots(seed):
    """Random bytes, and a good area next to a broken one."""
    rng = np.random.default_rng(seed)
    device = Device()
    assert device.commit(record(1))
    assert device.commit(record(2))
    broken = int(rng.integers(0, 2))
    area = np.frombuffer(ffi.buffer(device.board.store[broken].bytes), np.uint8)
    size = 16 + lib.CALIBRATION_RECORD_BYTES
    area[rng.integers(0, size, 3)] ^= rng.integers(1, 256, 3).astype(np.uint8)
    device.boot()
    assert device.in_use in ((record(1), 1), (record(2), 2))
    for area in device.board.store:
        np.frombuffer(ffi.buffer(area.bytes), np.uint8)[:] = rng.integers(0, 256, lib.BOARD_STORE_BYTES)
    device.boot()
    assert device.in_use[1] == 0
    assert device.commit(record(3))
    device.boot()
    assert device.in_use == (record(3), 1)


def test_sequence_number_wraps():
    device = Device()
    lib.calibration_store_save(device.store, device.board, record(1), 2**32 - 1)
    device.boot()
    assert device.in_use == (record(1), 2**32 - 1)
    assert device.commit(record(2))
    device.boot()
    assert device.in_use == (record(2), 0)


def test_store_that_cannot_be_written_keeps_the_old():
    device = Device()
    assert device.commit(record(1))
    assert not device.commit(record(2), cut_after=0)
    assert device.in_use == (record(1), 1)
    device.boot()
    assert device.in_use == (record(1), 1)
