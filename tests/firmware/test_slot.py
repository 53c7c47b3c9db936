"""One slot's way from nothing to readings and back, transaction by transaction, with scripted parts."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from firmware.test_decode import hmc5983_burst, lis2dw12_burst, mmc5983ma_burst
from ribbonhil._firmware import ffi, lib
from ribbonhost.wire import SlotReason

LIS2DW12, MMC5983MA, HMC5983 = 0, 1, 2
PERIOD_US = 10_000
IDENTITY = {0x8F: b"\x44", 0xAF: b"\x30", 0xCA: b"H43"}

Answer = Callable[[bytes], bytes]


class Part:
    """A part that keeps its control registers and samples something new every time it is read."""

    def __init__(self, index: int) -> None:
        self.index = index
        self.registers: dict[int, int] = {}
        self.log: list[bytes] = []
        self.samples = 0
        self.polarity = 0
        self.burst: Callable[[], bytes] | None = None

    def __call__(self, tx: bytes) -> bytes:
        self.log.append(tx)
        command, data = tx[0], tx[1:]
        identity = {LIS2DW12: 0x8F, MMC5983MA: 0xAF, HMC5983: 0xCA}[self.index]
        if command == identity:
            return IDENTITY[identity][: len(data)]
        if command & 0x80 == 0:
            if self.index == MMC5983MA and tx in (b"\x09\x08", b"\x09\x10"):
                self.polarity = int(tx == b"\x09\x10")
            for offset, value in enumerate(data):
                self.registers[(command & 0x3F) + offset] = value
            return bytes(len(data))
        if command == lib.PARTS[self.index].burst_command and len(data) > 6:
            self.samples += 1
            return self.burst() if self.burst else self.sample()
        if command == lib.PARTS[self.index].config_read_command:
            return bytes(self.registers.get((command & 0x3F) + i, 0) for i in range(len(data)))
        return b"\x5a" * len(data)

    def sample(self) -> bytes:
        wiggle = self.samples % 7
        if self.index == LIS2DW12:
            return lis2dw12_burst((wiggle, -3, 4000 + wiggle))
        if self.index == MMC5983MA:
            sign = 1 - 2 * self.polarity
            return mmc5983ma_burst((sign * 3000 + 500 + wiggle, sign * -6000 + 20, sign * 10 - wiggle))
        return hmc5983_burst((200 + wiggle, -300, 12))


def nothing(tx: bytes) -> bytes:
    return b"\xff" * (len(tx) - 1)


class Bench:
    """A slot with something in it, and time."""

    def __init__(self, kind: int, answer: Answer) -> None:
        self.setup = ffi.new("struct slot_setup *")
        for index in range(3):
            lib.part_configure(
                lib.PARTS[index], 1_000_000 // PERIOD_US, ffi.addressof(self.setup.configs[index])
            )
        self.setup.bridge_pairs = 400
        self.setup.scan_us = PERIOD_US
        self.slot = ffi.new("struct slot *")
        self.now_us = 2**32 - 200_000
        lib.slot_init(self.slot, kind, self.now_us)
        self.answer = answer

    def do(self, which: int) -> bool:
        """One pass; whether the slot had a transaction."""
        tx = ffi.new("uint8_t[]", lib.SLOT_TRANSFER_MAX)
        n = lib.slot_begin(self.slot, self.setup, which, self.now_us, tx)
        if n == 0:
            return False
        sent = bytes(ffi.buffer(tx, n))
        got = self.answer(sent)
        assert len(got) == n - 1
        lib.slot_end(self.slot, self.setup, self.now_us, b"\xff" + got)
        return True

    def scan(self) -> SlotReason:
        """One period: patrols, measurement, reading."""
        for _ in range(4):
            self.now_us = (self.now_us + PERIOD_US // 5) % 2**32
            self.do(lib.SLOT_PASS_PATROL)
        self.do(lib.SLOT_PASS_POLARISE)
        self.do(lib.SLOT_PASS_TRIGGER)
        self.now_us = (self.now_us + PERIOD_US // 5) % 2**32
        self.do(lib.SLOT_PASS_READ)
        lib.slot_judge(self.slot, self.now_us)
        return SlotReason(self.slot.reason)

    def run(self, seconds: float) -> list[SlotReason]:
        return [self.scan() for _ in range(round(seconds * 1e6 / PERIOD_US))]


def bench(part: Part) -> Bench:
    kind = lib.PART_ACCELEROMETER if part.index == LIS2DW12 else lib.PART_MAGNETOMETER
    return Bench(kind, part)


@pytest.mark.parametrize("index", [LIS2DW12, MMC5983MA, HMC5983])
def test_part_is_found_configured_and_read(index):
    part = Part(index)
    b = bench(part)
    reasons = b.run(0.2)
    assert reasons[-1] == SlotReason.OK
    assert reasons.index(SlotReason.OK) <= 6
    assert lib.slot_part(b.slot) == lib.PARTS[index]
    config = b.setup.configs[index]
    written = [tx for tx in part.log if tx[0] == lib.PARTS[index].config_write_command]
    count = lib.PARTS[index].config_count
    assert bytes([lib.PARTS[index].config_write_command]) + bytes(config.registers)[:count] in written


def test_i2c_is_switched_off_in_the_first_write_to_an_accelerometer():
    part = Part(LIS2DW12)
    bench(part).run(0.1)
    first_write = next(tx for tx in part.log if tx[0] & 0x80 == 0)
    assert first_write[0] == 0x21
    assert first_write[1] & 0x02


def test_bridge_offset_is_cancelled_in_what_is_told():
    """The scripted part reads +-field + offset; the counts told are the field's, and positive polarity."""
    part = Part(MMC5983MA)
    b = bench(part)
    b.run(2.0)
    assert list(b.slot.counts) == pytest.approx([3000, -6000, 10], abs=12)


def test_empty_slot_is_absent_and_looked_at_again():
    b = Bench(lib.PART_ACCELEROMETER, nothing)
    assert set(b.run(2.0)[5:]) == {SlotReason.ABSENT}
    b.answer = Part(LIS2DW12)
    reasons = b.run(1.0)
    assert reasons[-1] == SlotReason.OK
    assert reasons.index(SlotReason.OK) < 40


@pytest.mark.parametrize("kind", [lib.PART_ACCELEROMETER, lib.PART_MAGNETOMETER])
def test_identity_that_no_driver_knows_is_a_wrong_id(kind):
    b = Bench(kind, lambda tx: b"\x12" * (len(tx) - 1))
    assert set(b.run(1.0)[5:]) == {SlotReason.WRONG_ID}


def test_accelerometer_in_the_place_of_a_magnetometer_is_a_wrong_id():
    b = Bench(lib.PART_MAGNETOMETER, Part(LIS2DW12))
    assert set(b.run(1.0)[5:]) == {SlotReason.WRONG_ID}


def test_lost_configuration_is_noticed_and_written_again():
    part = Part(LIS2DW12)
    b = bench(part)
    b.run(0.5)
    part.registers[0x20] = 0
    part.burst = lambda: lis2dw12_burst((1, 2, 3), status=0) if part.registers[0x20] == 0 else part.sample()
    reasons = b.run(0.5)
    assert SlotReason.NOT_CONFIGURED in reasons
    assert reasons[-1] == SlotReason.OK
    assert part.registers[0x20] == b.setup.configs[LIS2DW12].registers[0]


def test_wrong_answer_to_a_check_is_believed_only_when_it_comes_twice():
    part = Part(LIS2DW12)
    b = bench(part)
    b.run(0.5)
    flipped = []

    def once_wrong(tx: bytes) -> bytes:
        got = part(tx)
        if tx[0] == 0x8F and not flipped:
            flipped.append(tx)
            return b"\x45"
        return got

    b.answer = once_wrong
    resets = sum(tx[0] == 0x21 for tx in part.log)
    reasons = b.run(1.0)
    assert flipped
    assert set(reasons) == {SlotReason.OK, SlotReason.NOISY}, "a line that errs is told, and no more"
    assert reasons[-1] == SlotReason.OK
    assert sum(tx[0] == 0x21 for tx in part.log) == resets, "the part was not brought up again"


@pytest.mark.parametrize("index", [LIS2DW12, MMC5983MA, HMC5983])
def test_samples_that_repeat_are_stuck(index):
    part = Part(index)
    b = bench(part)
    b.run(0.5)
    frozen = part.sample()
    part.burst = lambda: frozen
    reasons = b.run(0.5)
    assert reasons[-1] == SlotReason.STUCK
    part.burst = None
    assert b.run(0.3)[-1] == SlotReason.OK


def test_part_that_is_stuck_for_long_stays_so_when_the_clock_wraps():
    """After 71.6 minutes the last change seems to have been just now."""
    part = Part(LIS2DW12)
    b = bench(part)
    b.run(0.5)
    frozen = part.sample()
    part.burst = lambda: frozen
    b.run(1.0)
    assert b.slot.reason == SlotReason.STUCK
    reasons = set()
    for _ in range(17_400):  # a quarter of a second each
        b.now_us = (b.now_us + 240_000) % 2**32
        reasons.add(b.scan())
    assert SlotReason.OK not in reasons


NOTHING_NEW = [
    (LIS2DW12, lis2dw12_burst((1, 2, 3), status=0)),
    (MMC5983MA, mmc5983ma_burst((1, 2, 3), status=0x10)),
    (HMC5983, hmc5983_burst((1, 2, 3), mode=1)),
]


@pytest.mark.parametrize(("index", "old"), NOTHING_NEW)
def test_no_new_sample_for_four_periods_of_the_part_and_a_scan_is_stale(index, old):
    part = Part(index)
    b = bench(part)
    b.run(0.5)
    part.burst = lambda: old
    reasons = b.run(0.4)
    patience_us = max(4e6 / b.setup.configs[index].sample_hz, 1.5 * PERIOD_US)
    held = reasons.index(SlotReason.STALE)
    assert (held + 1) * PERIOD_US > patience_us
    assert held * PERIOD_US <= patience_us
    assert reasons[-1] in (SlotReason.STALE, SlotReason.NOT_CONFIGURED)
    part.burst = None
    assert b.run(0.3)[-1] == SlotReason.OK


@pytest.mark.parametrize(("index", "old"), NOTHING_NEW)
def test_scan_without_a_new_sample_now_and_then_does_no_harm(index, old):
    """As where a part's own clock is slower, or a status bit was read wrongly."""
    part = Part(index)
    b = bench(part)
    b.run(0.5)
    part.burst = lambda: old if part.samples % 5 == 0 else part.sample()
    assert set(b.run(1.0)) == {SlotReason.OK}


def test_sample_of_a_slow_scan_is_not_kept_for_the_next():
    """At 10 Hz it would be a tenth of a second old."""
    part = Part(LIS2DW12)
    b = bench(part)
    b.setup.scan_us = 100_000
    b.run(0.5)
    part.burst = lambda: lis2dw12_burst((1, 2, 3), status=0)
    assert b.run(0.01)[-1] == SlotReason.STALE


def test_axis_at_the_end_of_its_range_is_told():
    part = Part(LIS2DW12)
    b = bench(part)
    b.run(0.5)
    part.burst = lambda: lis2dw12_burst((8191, part.samples % 5, 100))
    assert b.run(0.1)[-1] == SlotReason.SATURATED


def test_rate_change_reaches_a_running_part_without_a_gap():
    part = Part(LIS2DW12)
    b = bench(part)
    b.run(0.5)
    lib.part_configure(lib.PARTS[LIS2DW12], 200, ffi.addressof(b.setup.configs[LIS2DW12]))
    lib.slot_reconfigure(b.slot, b.now_us)
    assert set(b.run(0.3)) == {SlotReason.OK}
    assert part.registers[0x20] == b.setup.configs[LIS2DW12].registers[0]


def test_errors_count_scans_without_a_reading_and_stop_at_65535():
    b = Bench(lib.PART_ACCELEROMETER, nothing)
    b.run(1.0)
    assert b.slot.errors == 100
    b.slot.errors = 65534
    b.run(0.1)
    assert b.slot.errors == 65535


def test_implausible_reading_keeps_a_slot_out_for_a_while():
    part = Part(LIS2DW12)
    b = bench(part)
    b.run(0.5)
    lib.slot_mark_implausible(b.slot, True, b.now_us)
    lib.slot_judge(b.slot, b.now_us)
    assert b.slot.reason == SlotReason.NOISY
    reasons = b.run(0.5)
    assert reasons[:29] == [SlotReason.NOISY] * 29
    assert reasons[-1] == SlotReason.OK


def test_reading_that_only_does_not_fit_in_is_still_told_without_a_gap():
    """Parts off the shelf differ by more than a calibrated ribbon's: what calibrates them must read them."""
    part = Part(MMC5983MA)
    b = bench(part)
    b.run(0.5)
    begun = len(part.log)
    for _ in range(round(2.0e6 / PERIOD_US)):
        lib.slot_mark_implausible(b.slot, False, b.now_us)
        assert b.scan() == SlotReason.OUT_OF_RANGE
        assert list(lib.slot_reading(b.slot)[0:3]) == pytest.approx([3000, -6000, 10], abs=12)
    reset = bytes(lib.PARTS[MMC5983MA].reset)
    assert reset not in part.log[begun:]

    told = []
    for _ in range(round(62e6 / PERIOD_US)):
        if b.slot.has_sample and b.slot.state == lib.SLOT_RUN:
            lib.slot_mark_implausible(b.slot, False, b.now_us)
        told.append(b.scan())
        if told[-1] == SlotReason.OUT_OF_RANGE:
            assert list(lib.slot_reading(b.slot)[0:3]) == pytest.approx([3000, -6000, 10], abs=20)
    assert reset in part.log[begun:], "after a minute it is tried"
    assert SlotReason.NOT_CONFIGURED in told
