"""`make probe`: what is compiled, how it gets onto a board, and what is said when it cannot."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from hil.micropython_board import micropython_board
from ribbonhil._firmware import lib
from ribbonhil.emulated_device import PARTS, Device
from ribbonhil.faults import Fault, FaultKind
from ribbonhil.firmware_build import FIRMWARE
from ribbonhil.probe import build as building
from ribbonhil.probe import run as running
from ribbonhil.probe.build import build
from ribbonhil.probe.emulated import (
    EmulatedPins,
    Supply,
    at_rest,
    micropython,
    parse_fault,
)
from ribbonhil.stm32f405.boards import BOARDS
from ribbonhost.errors import RibbonError, UsageError

SLOTS = 4
ROOT = Path(__file__).resolve().parents[2]


class SlowPins(EmulatedPins):
    """In no hurry from the moment on at which a person must do something."""

    is_slow = False

    def answer(self, line: str) -> str | None:
        self.is_slow = self.is_slow or line.startswith("sleep 5000000")
        if self.is_slow and line.startswith("sleep"):
            time.sleep(0.02)
        return super().answer(line)


def pins(*faults: Fault, of: type[EmulatedPins] = EmulatedPins) -> EmulatedPins:
    emulated = of("pyboard_v11", Device(seed=2, parts=PARTS[:SLOTS]), at_rest(SLOTS), Supply())
    for fault in faults:
        emulated.string.add_fault(fault)
    return emulated


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "ribbonhil.probe.run", *arguments]


def test_mpremote_takes_the_probe_to_the_board_and_its_result_is_the_exit_status():
    with micropython_board(pins()) as board:
        done = subprocess.run(
            command("--port", board.port, "--slots", str(SLOTS)), capture_output=True, text=True
        )
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[0] == f"String of {SLOTS} slots on a pyboard_v11, SPI at 500 kHz"
    assert [line.split()[1] for line in lines if line.endswith(" ok")] == ["LIS2DW12", "MMC5983MA"] * 2
    assert any(line.startswith(f"PASS: {SLOTS} slots") for line in lines)


def test_fault_on_the_board_is_exit_status_1():
    with micropython_board(pins(Fault(FaultKind.ABSENT, 2))) as board:
        done = subprocess.run(
            command("--port", board.port, "--slots", str(SLOTS)), capture_output=True, text=True
        )
    assert (done.returncode, done.stderr) == (1, "")
    assert "FAIL: 1 fault found." in done.stdout


def test_ctrl_c_ends_the_probe_on_the_board_too_and_leaves_no_slot_selected():
    emulated = pins(of=SlowPins)
    with micropython_board(emulated) as board:
        process = subprocess.Popen(
            command("--port", board.port, "--slots", str(SLOTS), "--walk"),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("Now push"):
                break
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate()
    assert (process.returncode, errors) == (130, "Stopped.\n")
    assert b"FAIL: stopped before the end" in board.said
    assert emulated.selected == 0


PORTS = [
    ([], "No board that runs MicroPython is connected by USB. "),
    ([("/dev/ttyS0", None)], "No board that runs MicroPython is connected by USB (ports: /dev/ttyS0). "),
    (
        [("/dev/ttyACM1", 0xF055), ("/dev/ttyACM0", 0xF055)],
        "2 boards run MicroPython: choose one with make probe PORT=",
    ),
]


@pytest.mark.parametrize(("ports", "start"), PORTS)
def test_no_board_or_several_are_told_in_one_sentence(
    ports: list[tuple[str, int | None]], start: str, monkeypatch: pytest.MonkeyPatch
):
    listed = [ListedPort(*port) for port in ports]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: listed)
    with pytest.raises(RibbonError) as told:
        running.find_port()
    assert str(told.value).startswith(start)


class ListedPort(SimpleNamespace):
    """What pyserial tells of a port."""

    def __init__(self, device: str, vid: int | None) -> None:
        super().__init__(device=device, vid=vid)

    def __lt__(self, other: "ListedPort") -> bool:
        return bool(self.device < other.device)


def test_the_one_board_is_found_among_other_ports(monkeypatch: pytest.MonkeyPatch):
    listed = [ListedPort("/dev/ttyUSB0", 0x0403), ListedPort("/dev/ttyACM0", 0xF055)]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: listed)
    assert running.find_port() == "/dev/ttyACM0"


def test_port_that_is_not_there_is_exit_status_1_and_one_sentence():
    done = subprocess.run(command("--port", "/dev/ttyACM99"), capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("/dev/ttyACM99 cannot be opened: it is not there, ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("said", "start"),
    [
        (["b''", "mpremote: could not enter raw repl"], "No MicroPython answers on PORT"),
        (
            ["String of 4 slots", "Traceback", "ValueError: incompatible .mpy file"],
            "MicroPython on the board is too old",
        ),
        (["String of 4 slots", "Traceback", "OSError: 5"], "The probe broke off on the board: OSError: 5"),
        ([], "The probe broke off on the board: it says nothing"),
    ],
)
def test_what_mpremote_says_becomes_what_to_do(said: list[str], start: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        running, "mpremote", lambda *_: [sys.executable, "-c", f"print('\\n'.join({said!r}))"]
    )
    shown: list[str] = []
    with pytest.raises(RibbonError) as told:
        running.probe("PORT", Path("."), SLOTS, False, shown.append)
    assert str(told.value).startswith(start)
    assert shown == said[:1] if said[:1] == ["String of 4 slots"] else shown == []


@pytest.mark.parametrize(
    ("arguments", "start"),
    [
        (("--board", "netduino"), "There is no board netduino: there are feather_f405, pyboard_v11"),
        (("--slots", "0"), "a string has 1 slot or more, not 0"),
    ],
)
def test_wrong_usage_is_exit_status_2(arguments: tuple[str, ...], start: str):
    done = subprocess.run(command(*arguments), capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, start + "\n")


@pytest.mark.parametrize("text", ["shorted", "sorted:1:2", "shorted:a:2", "shorted:1:b"])
def test_fault_that_is_none_is_refused(text: str):
    with pytest.raises(UsageError, match=r"KIND:SLOT\[:PARAMETER\]"):
        parse_fault(text if ":" in text else text + ":x")


@pytest.mark.parametrize("board", sorted(BOARDS))
def test_generated_pins_are_those_of_the_boards_schematic(board: str):
    wiring = BOARDS[board]
    assert building.pins(board) == {
        "SPI_SCK": wiring.spi_sck[1:],
        "SPI_MISO": wiring.spi_miso[1:],
        "SPI_MOSI": wiring.spi_mosi[1:],
        "SEL_CLK": wiring.sel_clk[1:],
        "SEL_DATA": wiring.sel_data[1:],
    }


def test_every_board_of_the_firmware_can_be_probed():
    headers = (FIRMWARE / "port" / "stm32f405" / "boards").glob("*.h")
    assert sorted(header.stem for header in headers) == sorted(BOARDS)


def test_bytecode_is_of_the_version_that_this_micropython_runs():
    """Only its first byte must agree: no part of the probe is machine code."""
    version = subprocess.run(
        [micropython(), "-c", "import sys; print(sys.implementation._mpy & 0xFF)"],
        capture_output=True,
        text=True,
    ).stdout
    for compiled in build("pyboard_v11").glob("*.mpy"):
        magic, of_file, flags = compiled.read_bytes()[:3]
        assert (magic, of_file, flags >> 2) == (ord("M"), int(version), 0)


def test_module_that_is_no_more_is_not_sent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(building, "PROBE", tmp_path)
    compiled = tmp_path / "build" / "pyboard_v11"
    compiled.mkdir(parents=True)
    (compiled / "gone.mpy").write_bytes(b"M")
    sources = {source.stem for source in building.SOURCES.glob("*.py")}
    assert building.build.__wrapped__("pyboard_v11") == compiled
    assert {path.name for path in compiled.parent.rglob("*") if path.is_file()} == {
        f"{name}.mpy" for name in {*sources, "hardware"}
    }


def test_probe_says_nothing_of_a_part_or_pin_that_the_firmware_says():
    """Register addresses, identities and pins come from its headers."""
    names = {f"{part}_" for part in ("LIS2DW12", "MMC5983MA", "HMC5983")}
    for source in building.SOURCES.glob("*.py"):
        text = source.read_text("utf-8")
        assert not re.findall(r"\b0x(?!FF\b|1FFF7A2A\b)[0-9a-fA-F]+", text), source.name
        assert not re.findall(rf"^({'|'.join(names)})\w* *=", text, re.MULTILINE), source.name


def test_register_that_no_header_has_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / "wrong.py").write_text("import hardware as hw\nprint(hw.LIS2DW12_CTRL99)\n")
    monkeypatch.setattr(building, "SOURCES", tmp_path)
    with pytest.raises(RibbonError, match="LIS2DW12_CTRL99, which no header"):
        building.hardware("pyboard_v11")


def test_slots_are_those_of_the_firmware_unless_told():
    assert f"SLOTS = {lib.RIBBON_SLOT_COUNT}\n" in building.hardware("pyboard_v11")
