"""`make flash`: the file for dfu-util, and what the command does, against a stand-in for dfu-util.

The ribbons that are asked to start their boot loader run the image, or stand in for serial ports.
"""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "firmware/tools"))

import flash as flash_tool
from dfu_file import dfu_file
from enter_dfu import RunningRibbon
from image.programs import built

TOOLS = Path(__file__).resolve().parents[2] / "firmware/tools"

IMAGE = bytes(range(256)) * 5

# Lists the boards of $BOARDS, and those of $LATER from the third look on; keeps what is downloaded in $FLASH,
# and gives it back on upload.
STAND_IN = """#!{python}
import os, sys
from pathlib import Path
arguments, flash, log = sys.argv[1:], Path(os.environ["FLASH"]), Path(os.environ["LOG"])
with log.open("a") as file:
    file.write(" ".join(arguments) + "\\n")
if arguments == ["--list"]:
    looks = log.read_text().split("\\n").count("--list")
    if "DENIED" in os.environ:
        reason = os.environ["DENIED"]
        print(f"dfu-util: Cannot open DFU device 0483:df11 found on devnum 9 ({{reason}})", file=sys.stderr)
    for serial in os.environ["BOARDS"].split() + (os.environ.get("LATER", "").split() if looks >= 3 else []):
        for alt in range(2):
            print(f'Found DFU: [0483:df11] ver=2200, devnum=9, cfg=1, intf=0, path="1-1", alt={{alt}}, '
                  f'name="@Internal Flash", serial="{{serial}}"')
elif "--download" in arguments:
    whole = Path(arguments[arguments.index("--download") + 1]).read_bytes()
    flash.write_bytes(whole[293:-16] if "BROKEN" not in os.environ else b"x" * (len(whole) - 309))
elif "--upload" in arguments:
    if "leave" in " ".join(arguments) and "GONE" in os.environ:
        sys.exit("dfu-util: Error during download get_status")
    n = int(arguments[arguments.index("--dfuse-address") + 1].split(":")[1])
    Path(arguments[arguments.index("--upload") + 1]).write_bytes(flash.read_bytes()[:n])
"""


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A folder with an image, and the stand-in in bin/."""
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin/dfu-util"
    program.write_text(STAND_IN.format(python=sys.executable))
    program.chmod(0o755)
    (tmp_path / "ribbon.bin").write_bytes(IMAGE)
    (tmp_path / "ribbon.dfu").write_bytes(dfu_file(IMAGE))
    return tmp_path


def flash(bench: Path, boards: str, *arguments: str, **extra: str) -> subprocess.CompletedProcess[str]:
    """Runs the command with these boards in DFU mode."""
    environment = {**os.environ, "PATH": str(bench / "bin"), "BOARDS": boards, "FLASH": str(bench / "flash"),
                   "LOG": str(bench / "log"), **extra}  # fmt: skip
    command = [sys.executable, str(TOOLS / "flash.py"), "--board", "pyboard_v11", "--baud", "921600"]
    command += [*arguments, str(bench / "ribbon.bin")]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


def test_dfu_file_says_where_its_one_element_goes() -> None:
    data = dfu_file(IMAGE)
    assert data[:5] == b"DfuSe"
    version, size, targets = struct.unpack_from("<BIB", data, 5)
    assert (version, size, targets) == (1, len(data) - 16, 1)
    assert data[11:17] == b"Target"
    target_bytes, elements = struct.unpack_from("<II", data, 277)
    address, image_bytes = struct.unpack_from("<II", data, 285)
    assert (target_bytes, elements) == (8 + len(IMAGE), 1)
    assert (address, image_bytes) == (0x08000000, len(IMAGE))
    assert data[293:-16] == IMAGE
    device, product, vendor, dfu, signature, length, crc = struct.unpack("<HHHH3sBI", data[-16:])
    assert (product, vendor, dfu, signature, length) == (0xDF11, 0x0483, 0x011A, b"UFD", 16)
    assert crc == zlib.crc32(data[:-4]) ^ 0xFFFFFFFF
    assert device == 0xFFFF


def test_board_is_flashed_verified_and_started(bench: Path) -> None:
    result = flash(bench, "345A")
    assert (result.returncode, result.stderr) == (0, "")
    assert "345A flashed, verified and started" in result.stdout
    assert (bench / "flash").read_bytes() == IMAGE
    assert "leave" in (bench / "log").read_text().splitlines()[-1]


def test_no_dfu_util_tells_what_to_install(bench: Path) -> None:
    (bench / "bin/dfu-util").unlink()
    result = flash(bench, "345A")
    assert result.returncode == 1
    assert "apt-get install dfu-util" in result.stderr


def test_two_boards_ask_for_a_serial_number(bench: Path) -> None:
    result = flash(bench, "345A 77B0")
    assert result.returncode == 1
    assert "SERIAL=345A|77B0" in result.stderr
    assert flash(bench, "345A 77B0", "--serial", "77B0").returncode == 0
    assert flash(bench, "345A", "--serial", "9999").returncode == 1


def test_flash_that_does_not_hold_the_image_is_not_started(bench: Path) -> None:
    result = flash(bench, "345A", BROKEN="1")
    assert result.returncode == 1
    assert "not the image" in result.stderr
    assert "leave" not in (bench / "log").read_text()


def test_board_that_starts_before_it_answers_is_flashed(bench: Path) -> None:
    result = flash(bench, "345A", GONE="1")
    assert (result.returncode, result.stderr) == (0, "")
    assert "flashed and verified; if it does not run, press RST" in result.stdout


def test_missing_permission_names_the_udev_rule(bench: Path) -> None:
    result = flash(bench, "", DENIED="LIBUSB_ERROR_ACCESS")
    assert result.returncode == 1
    assert 'ATTR{idVendor}=="0483", ATTR{idProduct}=="df11"' in result.stderr
    assert "/etc/udev/rules.d/" in result.stderr
    assert "press RST" not in result.stderr


def test_missing_driver_names_the_program_that_installs_it(bench: Path) -> None:
    result = flash(bench, "", DENIED="LIBUSB_ERROR_NOT_SUPPORTED")
    assert result.returncode == 1
    assert "Zadig" in result.stderr


def test_running_ribbon_is_asked_over_its_link(bench: Path) -> None:
    link = f"emulated://rest/0?ribbons=1&image={built()}"
    result = flash(bench, "77B0", "--link", link, LATER="345A")
    assert (result.returncode, result.stderr) == (0, "")
    assert "starts its boot loader" in result.stdout
    assert "Board 345A flashed, verified and started" in result.stdout


def test_ribbon_on_another_board_is_not_asked(bench: Path) -> None:
    result = flash(bench, "", "--link", "emulated://rest/0?ribbons=1", LATER="345A")
    assert result.returncode == 1
    assert "runs on host, this image is for pyboard_v11" in result.stderr


def test_link_without_a_ribbon_is_told(bench: Path) -> None:
    result = flash(bench, "", "--link", "/dev/no_such_port", LATER="345A")
    assert result.returncode == 1
    assert "cannot open /dev/no_such_port" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.fixture
def ribbons(bench: Path, monkeypatch: pytest.MonkeyPatch) -> list[RunningRibbon]:
    """What is found on serial ports, to be filled in; asked ones start their boot loader."""
    found: list[RunningRibbon] = []
    for name, value in {"PATH": str(bench / "bin"), "BOARDS": "", "FLASH": str(bench / "flash")}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("LOG", str(bench / "log"))
    monkeypatch.setattr(flash_tool, "running_ribbons", lambda baud: found)
    monkeypatch.setattr(flash_tool, "enter_dfu", lambda url, board, baud: f"of {url}")
    monkeypatch.setattr(flash_tool, "APPEARS_S", 2.0)
    return found


def flash_what_is_found(bench: Path) -> str:
    dfu = bench / "ribbon.dfu"
    return flash_tool.flash(IMAGE, dfu, serial=None, board="pyboard_v11", link=None, baud=921_600)


def test_no_board_and_no_ribbon_tells_what_to_press(bench: Path, ribbons: list[RunningRibbon]) -> None:
    with pytest.raises(flash_tool.FlashError) as error:
        flash_what_is_found(bench)
    assert "pyboard v1.1:       connect DFU to 3V3, press RST, disconnect DFU" in str(error.value)
    assert "Feather STM32F405:  connect B0 to 3.3V, press RESET, disconnect B0" in str(error.value)


def test_the_one_ribbon_on_a_serial_port_is_asked(
    bench: Path,
    ribbons: list[RunningRibbon],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    ribbons[:] = [RunningRibbon("COM1", "aa", "feather_f405"), RunningRibbon("COM5", "bb", "pyboard_v11")]
    monkeypatch.setenv("LATER", "345A")
    assert flash_what_is_found(bench) == "Board 345A flashed, verified and started"
    assert "Ribbon of COM5 at COM5 starts its boot loader" in capsys.readouterr().out


def test_of_several_ribbons_one_must_be_named(bench: Path, ribbons: list[RunningRibbon]) -> None:
    ribbons[:] = [RunningRibbon("COM5", "aa", "pyboard_v11"), RunningRibbon("COM6", "bb", "pyboard_v11")]
    with pytest.raises(flash_tool.FlashError, match=r"2 ribbons run here[^$]*LINK=COM5[^$]*LINK=COM6"):
        flash_what_is_found(bench)


def test_ribbon_whose_usb_is_not_plugged_in_is_told(bench: Path, ribbons: list[RunningRibbon]) -> None:
    ribbons[:] = [RunningRibbon("COM5", "aa", "pyboard_v11")]
    with pytest.raises(flash_tool.FlashError, match="no board in DFU mode appears on USB"):
        flash_what_is_found(bench)
