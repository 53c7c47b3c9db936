"""What board.h promises of the STM32F405, one function after the other, in the model."""

import ctypes
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from image.programs import FIRMWARE, built
from image.qemu import Qemu
from ribbonhil.stm32f405.boards import BOARDS
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.mcu import Bus, Mcu, Options, Stop
from ribbonhost.wire import Board, ClockSource, ResetCause

AREA_START = (0x08008000, 0x0800C000)
STORE_BYTES = 8192
WATCHDOG_MAX_S = 2.1
READY = b"REDYREDY"


def number(value: int) -> int:
    """A 32-bit number as signed."""
    return value - 2**32 if value >= 2**31 else value


def command(letter: str, a: int = 0, b: int = 0, c: int = 0) -> bytes:
    return struct.pack("<cIII", letter.encode(), a, b, c)


class Bench:
    """The bench program in an MCU."""

    def __init__(self, board: str = "pyboard_v11", *, bus: Bus | None = None, **options: object) -> None:
        self.program = read_elf(built("port_bench", board, core=False))
        wiring = BOARDS[board]
        if options.pop("without_crystal", False):
            wiring = type(wiring)(**{**vars(wiring), "crystal_hz": 0})
        self.mcu = Mcu(self.program.image, wiring, bus, options=Options(**options))  # type: ignore[arg-type]
        self.wait_for_start()

    def wait_for_start(self) -> None:
        """Lets the program start, or start again."""
        self.mcu.run_for(0.1)
        assert self.mcu.read().endswith(READY)

    def ask(self, letter: str, a: int = 0, b: int = 0, c: int = 0, seconds: float = 1.0) -> tuple[int, int]:
        """The answer to a command."""
        answer = self.ask_without_waiting(letter, a, b, c, seconds)
        assert len(answer) == 8
        first, second = struct.unpack("<II", answer)
        return first, second

    def ask_without_waiting(
        self, letter: str, a: int = 0, b: int = 0, c: int = 0, seconds: float = 1.0
    ) -> bytes:
        """What comes within some time."""
        self.mcu.write(command(letter, a, b, c))
        answer, end_s = b"", self.mcu.now_s + seconds
        while len(answer) < 8 and self.mcu.now_s < end_s:
            stop = self.mcu.run_for(0.01, stop_at_reset=True)
            answer += self.mcu.read()
            if stop != Stop.AT_HORIZON:
                break
        return answer


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    assert made.mcu.violation == ""
    made.mcu.close()


def area_bytes(bench: Bench, area: int) -> bytes:
    return bench.mcu.peek(AREA_START[area], STORE_BYTES)


def test_crystal_gives_168_mhz(bench: Bench) -> None:
    assert bench.ask("c") == (ResetCause.POWER_ON, ClockSource.CRYSTAL)
    assert bench.mcu.counters.hclk_hz == 168_000_000


def test_without_a_crystal_the_internal_oscillator_gives_168_mhz() -> None:
    bench = Bench(without_crystal=True)
    assert bench.ask("c") == (ResetCause.POWER_ON, ClockSource.INTERNAL_RC)
    assert bench.mcu.counters.hclk_hz == 168_000_000
    assert bench.mcu.violation == ""


def test_crystal_that_stops_costs_a_restart_not_the_device() -> None:
    bench = Bench(crystal_fails_us=200_000)
    assert bench.ask("c") == (ResetCause.POWER_ON, ClockSource.CRYSTAL)
    bench.mcu.run_until(0.3)
    assert bench.mcu.read() == READY
    assert bench.ask("c") == (ResetCause.SOFTWARE, ClockSource.INTERNAL_RC)
    assert bench.mcu.violation == ""


@pytest.mark.parametrize(
    ("board", "identity"), [("pyboard_v11", Board.PYBOARD_V11), ("feather_f405", Board.FEATHER_F405)]
)
def test_boards_differ_in_data_only(board: str, identity: Board) -> None:
    bench = Bench(board, unique_id=bytes(range(100, 112)))
    words = [bench.ask("u", word) for word in range(3)]
    assert b"".join(struct.pack("<I", first) for first, _ in words) == bytes(range(100, 112))
    assert {second for _, second in words} == {identity}
    bench.ask("L", 1)
    assert bench.mcu.led
    bench.ask("L", 0)
    assert not bench.mcu.led
    assert bench.mcu.violation == ""


@pytest.mark.parametrize("celsius", [-40.0, 25.0, 85.0])
def test_temperature_is_read_to_half_a_degree(celsius: float) -> None:
    millidegrees, has_dfu = Bench(temperature_c=celsius).ask("t")
    assert number(millidegrees) == pytest.approx(1000 * celsius, abs=500)
    assert has_dfu


@pytest.mark.parametrize("wait_us", [1, 10, 999, 5_000, 700_000])
def test_wait_ends_within_5_us_of_its_time(bench: Bench, wait_us: int) -> None:
    late_us, took_us = bench.ask("w", wait_us)
    assert 0 <= late_us <= 5
    assert took_us == wait_us + late_us


def test_wait_sleeps(bench: Bench) -> None:
    before = bench.mcu.counters
    bench.ask("w", 100_000)
    after = bench.mcu.counters
    assert after.sleep_ns - before.sleep_ns > 95_000_000
    assert after.instructions - before.instructions < 20_000


def test_microseconds_are_those_of_the_outer_world(bench: Bench) -> None:
    device_us, t_s = bench.mcu.device_us, bench.mcu.now_s
    bench.mcu.run_for(0.5)
    assert bench.mcu.device_us - device_us == pytest.approx((bench.mcu.now_s - t_s) * 1e6, abs=1.0)


@ctypes.CFUNCTYPE(ctypes.c_uint8, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_uint8)
def inverted(_context: int | None, _t_ns: int, mosi: int) -> int:
    """A bus that answers every byte with its complement."""
    return mosi ^ 0xFF


def test_transfer_that_is_given_up_leaves_nothing_to_the_next() -> None:
    address = ctypes.cast(inverted, ctypes.c_void_p).value
    assert address is not None
    bench = Bench(bus=Bus(transfer=address))
    assert bench.ask("S", 0, 0, 0x33) == (0xCC, 0)
    assert bench.ask("G") == (0xFF, 0xFF)
    assert bench.ask("S", 0, 0, 0x34) == (0xCB, 0)
    assert bench.ask("S", 0, 0, 0x35) == (0xCA, 0)
    assert bench.mcu.violation == ""


def test_received_byte_ends_a_wait(bench: Bench) -> None:
    bench.mcu.write(command("w", 500_000))
    bench.mcu.run_for(0.1)
    assert bench.mcu.read() == b""
    bench.mcu.write(b"c")
    bench.mcu.run_for(0.001)
    late_us, took_us = struct.unpack("<iI", bench.mcu.read())
    assert late_us < -390_000
    assert took_us < 110_000


def test_link_keeps_what_comes_while_nobody_reads(bench: Bench) -> None:
    commands = b"".join(command("u", word % 3) for word in range(70))  # 910 bytes, the ring holds 1024
    bench.mcu.write(commands)
    bench.mcu.run_for(0.2)
    assert len(bench.mcu.read()) == 70 * 8
    assert bench.mcu.counters.link_bytes_lost == 0


def test_store_is_written_and_read_back(bench: Bench) -> None:
    assert bench.ask("E", 0) == (1, 0)
    assert bench.ask("W", 0x0040 << 16, 64, 7) == (1, 0)
    expected = bytearray(b"\xff" * STORE_BYTES)
    expected[0x40:0x80] = bytes(range(7, 71))
    assert area_bytes(bench, 0) == expected
    total = 0
    for byte in expected[0x20:0xA0]:
        total = (total * 31 + byte) % 2**32
    assert bench.ask("R", 0x0020 << 16, 0x80) == (total, 0)


def test_erase_leaves_the_other_area_and_the_image_alone(bench: Bench) -> None:
    image = bench.mcu.peek(0x08000000, 0x8000)
    for area in (0, 1):
        bench.ask("E", area)
        bench.ask("W", area, 256, area)
    bench.ask("E", 1)
    assert area_bytes(bench, 0)[:256] == bytes(range(256))
    assert area_bytes(bench, 1) == b"\xff" * STORE_BYTES
    assert bench.mcu.peek(0x08000000, 0x8000) == image


@pytest.mark.parametrize(
    ("offset", "n"),
    [(2, 4), (0, 6), (STORE_BYTES, 4), (STORE_BYTES - 4, 8)],
    ids=["offset", "n", "end", "over"],
)
def test_store_refuses_what_is_not_in_words_or_not_in_the_area(bench: Bench, offset: int, n: int) -> None:
    bench.ask("E", 0)
    assert bench.ask("W", offset << 16, n, 1) == (0, 0)
    assert area_bytes(bench, 0) == b"\xff" * STORE_BYTES


def test_write_over_what_was_written_is_reported() -> None:
    bench = Bench()
    bench.ask("E", 0)
    assert bench.ask("W", 0, 64, 0)[0] == 1
    assert bench.ask("W", 0, 64, 1)[0] == 0
    assert "without an erase" in bench.mcu.violation


def test_longest_erase_of_the_data_sheet_does_not_wake_the_watchdog() -> None:
    bench = Bench(erase_us=800_000)
    for area in (0, 1, 0):
        assert bench.ask("E", area, seconds=2.0) == (1, 0)
    assert bench.mcu.counters.watchdog_resets == 0


def test_power_cut_leaves_the_other_area_untouched() -> None:
    bench = Bench(seed=3)
    for area in (0, 1):
        bench.ask("E", area)
        bench.ask("W", area, 256, 0)
    for operation in (1, 2, 30):
        bench.mcu.cut_power_in_flash_operation(operation)
        for letter in ("E", "W"):
            bench.ask_without_waiting(letter, 1, 256, 5)
        bench.mcu.power_on()
        bench.wait_for_start()
        assert bench.ask("c") == (ResetCause.POWER_ON, ClockSource.CRYSTAL)
        assert area_bytes(bench, 0)[:256] == bytes(range(256))
        assert area_bytes(bench, 1)[:256] != bytes(range(5, 256)) + bytes(range(5))


def test_hung_loop_is_restarted_by_the_watchdog(bench: Bench) -> None:
    assert bench.ask_without_waiting("H", seconds=WATCHDOG_MAX_S) == b""
    assert bench.mcu.counters.watchdog_resets == 1
    bench.wait_for_start()
    assert bench.ask("c") == (ResetCause.WATCHDOG, ClockSource.CRYSTAL)
    assert bench.ask("f") == (0, 0)


def test_hard_fault_is_told_once_after_the_restart(bench: Bench) -> None:
    bench.ask_without_waiting("X")
    bench.wait_for_start()
    assert bench.ask("c") == (ResetCause.HARD_FAULT, ClockSource.CRYSTAL)
    pc, cfsr = bench.ask("f")
    assert bench.program.symbols["main"] <= pc < max(bench.program.symbols.values())
    assert cfsr == 0x8200  # precise bus error, address known
    bench.ask_without_waiting("H", seconds=WATCHDOG_MAX_S)
    bench.wait_for_start()
    assert bench.ask("c")[0] == ResetCause.WATCHDOG
    assert bench.ask("f") == (0, 0)


def test_stack_overflow_is_a_hard_fault_and_harms_no_variable(bench: Bench) -> None:
    bench.ask_without_waiting("O")
    bench.wait_for_start()
    assert bench.ask("c") == (ResetCause.HARD_FAULT, ClockSource.CRYSTAL)
    assert bench.program.symbols["stack_top"] <= bench.program.symbols["data_start"]


def test_dfu_enters_the_boot_loader_without_a_watchdog(bench: Bench) -> None:
    bench.mcu.write(command("D"))
    assert bench.mcu.run_for(1.0) == Stop.BOOT_LOADER
    assert bench.mcu.run_for(10.0) == Stop.BOOT_LOADER
    assert bench.mcu.counters.watchdog_resets == 0


def test_start_by_a_boot_loader_that_left_its_clocks_on_is_made_a_reset(bench: Bench) -> None:
    bench.ask_without_waiting("J")
    bench.wait_for_start()
    assert bench.ask("c") == (ResetCause.SOFTWARE, ClockSource.CRYSTAL)
    assert bench.mcu.counters.resets == 1


def test_answer_leaves_whole_before_the_boot_loader_is_entered(bench: Bench) -> None:
    bench.mcu.write(command("A"))
    assert bench.mcu.run_for(1.0) == Stop.BOOT_LOADER
    assert bench.mcu.read() == READY


def test_what_qemu_does_not_have_is_said_and_survived() -> None:
    with Qemu(built("port_bench", core=False)) as qemu:
        assert qemu.run_until(lambda output: len(output) == 8) == READY
        for letter in ("c", "t", "u", "S"):
            qemu.received = b""
            qemu.write(command(letter, 1, 1, 1))
            answer = struct.unpack("<II", qemu.run_until(lambda output: len(output) == 8))
            expected = {
                "c": (ResetCause.UNKNOWN, ClockSource.INTERNAL_RC),
                "t": (0, 0),  # no thermometer (not a number), no boot loader
                "u": (0, Board.PYBOARD_V11),
                "S": (0xFF, 0),  # no DMA: the bus reads as one where nothing is
            }
            assert answer == expected[letter]


def test_store_areas_are_no_part_of_the_image() -> None:
    for path in sorted(Path(FIRMWARE / "build/stm32f405").glob("*/*.bin")):
        assert path.stat().st_size <= AREA_START[0] - 0x08000000
