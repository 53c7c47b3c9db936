"""The image that is flashed, on emulated sensors: budgets, equality with the host's build, stress, faults."""

import re
import struct
from pathlib import Path

import pytest
from image.programs import built, make
from ribbonhil.emulated_device import drawn_device
from ribbonhil.scenes import BUILTIN
from ribbonhil.stm32f405.boards import BOARDS
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.stm32f405.mcu import Stop
from ribbonhil.stm32f405.replay import replay
from ribbonhil.stm32f405.run import RunOptions, run
from ribbonhil.stm32f405.session import Session
from ribbonhil.truth import comb_truth
from ribbonhost.wire import Board, ResetCause

INSTRUCTIONS_MAX = 60_000
UDF = b"\x00\xde"
BRANCH_TO_ITSELF = b"\xfe\xe7"
UNDEFINED_INSTRUCTION = 0x10000  # CFSR


def started(elf: Path, board: str = "pyboard_v11", log_events: int = 0) -> Session:
    """A ribbon of the wing that runs an image and has said who it is."""
    truth = comb_truth(BUILTIN["wing"], 2).ribbon(1)
    ribbon = ImageRibbon(read_elf(elf).image, truth, drawn_device(1, 1), BOARDS[board])
    if log_events:
        ribbon.mcu.start_log(log_events)
    session = Session(ribbon)
    session.wait_for_info()
    return session


@pytest.mark.parametrize("board", sorted(BOARDS))
def test_200_scans_a_second_equal_the_host_port_without_overrun(board: str) -> None:
    report = run(RunOptions(built(board=board), "wing", 300, rate_hz=200, board=board))
    assert report.frames == 300
    assert report.is_good, report
    assert report.instructions_per_frame <= INSTRUCTIONS_MAX
    assert report.invalid_nodes == 0
    assert report.scan_us < 5000


def test_parts_with_errors_read_the_same_in_the_image_and_in_the_host_port() -> None:
    ideal, real = (run(RunOptions(built(), "rest", 40, part_errors=seed)) for seed in (None, 3))
    assert ideal.is_good, ideal
    assert real.is_good, real


def test_info_tells_board_parts_and_serial_number() -> None:
    for name, board in (("pyboard_v11", Board.PYBOARD_V11), ("feather_f405", Board.FEATHER_F405)):
        session = started(built(board=name), name)
        assert session.info is not None
        assert session.info.board == board
        assert session.info.unique_id == drawn_device(1, 1).unique_id
        assert list(session.info.slots.part) == [1, 2] * 16


def test_second_build_is_byte_identical_and_tells_its_budgets(tmp_path: Path) -> None:
    first = built().with_suffix(".bin")
    make()
    result = make(f"OUT={tmp_path}")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "ribbon.bin").read_bytes() == first.read_bytes()
    numbers = re.search(
        r"flash (\d+) of 65536 bytes, static RAM (\d+) of 32768, stack (\d+) of 4096 at worst", result.stdout
    )
    assert numbers is not None, result.stdout
    assert all(int(n) > 1000 for n in numbers.groups())


def test_tick_at_50_khz_with_floating_point_changes_no_orientation() -> None:
    elf = built("stress")
    session = started(elf, log_events=2_000_000)
    session.run_for(1.5)
    ribbon = session.ribbon
    assert isinstance(ribbon, ImageRibbon)
    ticks = struct.unpack("<I", ribbon.mcu.peek(read_elf(elf).symbols["stress_ticks"], 4))[0]
    assert ticks == pytest.approx(50_000 * ribbon.now_s, rel=0.02)
    assert ribbon.mcu.counters.fp_frames > 0.9 * ticks
    replayed = replay(*ribbon.mcu.end_log())
    assert replayed.matches(session.orients)
    assert len(session.orients) > 140
    assert ribbon.mcu.violation == ""


def test_hard_fault_is_recorded_and_reported_after_the_restart() -> None:
    elf = built()
    address = read_elf(elf).symbols["app_poll"]
    session = started(elf)
    mcu = session.ribbon.mcu  # type: ignore[attr-defined]
    healthy = mcu.peek(address, 2)
    mcu.poke(address, UDF)
    assert mcu.run_for(0.1, stop_at_reset=True) == Stop.RESET
    mcu.poke(address, healthy)
    session.run_for(0.4)
    status = session.current_status()
    assert status.reset_cause == ResetCause.HARD_FAULT
    assert status.fault_pc == address
    assert status.fault_cfsr == UNDEFINED_INSTRUCTION
    assert read_elf(elf).symbols["main"] <= status.fault_lr < read_elf(elf).symbols["main"] + 200


def test_hung_loop_is_restarted_by_the_watchdog_and_says_so() -> None:
    elf = built()
    address = read_elf(elf).symbols["app_poll"]
    session = started(elf)
    mcu = session.ribbon.mcu  # type: ignore[attr-defined]
    healthy = mcu.peek(address, 2)
    mcu.poke(address, BRANCH_TO_ITSELF)
    assert mcu.run_for(2.5, stop_at_reset=True) == Stop.RESET
    assert mcu.counters.watchdog_resets == 1
    mcu.poke(address, healthy)
    before = len(session.orients)
    session.run_for(0.4)
    assert session.current_status().reset_cause == ResetCause.WATCHDOG
    assert len(session.orients) > before + 20
