"""`make flash`: the file for dfu-util, and what the command does, against a stand-in for dfu-util."""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "firmware/tools"))

from dfu_file import dfu_file

TOOLS = Path(__file__).resolve().parents[2] / "firmware/tools"

IMAGE = bytes(range(256)) * 5

# Lists the boards of $BOARDS, keeps what is downloaded in $FLASH, and gives it back on upload.
STAND_IN = """#!{python}
import os, sys
from pathlib import Path
arguments, flash = sys.argv[1:], Path(os.environ["FLASH"])
with open(os.environ["LOG"], "a") as log:
    log.write(" ".join(arguments) + "\\n")
if arguments == ["--list"]:
    for serial in os.environ["BOARDS"].split():
        for alt in range(2):
            print(f'Found DFU: [0483:df11] ver=2200, devnum=9, cfg=1, intf=0, path="1-1", alt={{alt}}, '
                  f'name="@Internal Flash", serial="{{serial}}"')
elif "--download" in arguments:
    whole = Path(arguments[arguments.index("--download") + 1]).read_bytes()
    flash.write_bytes(whole[293:-16] if "BROKEN" not in os.environ else b"x" * (len(whole) - 309))
elif "--upload" in arguments:
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
    command = [sys.executable, str(TOOLS / "flash.py"), *arguments, str(bench / "ribbon.bin")]
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


def test_no_board_tells_what_to_press(bench: Path) -> None:
    result = flash(bench, "")
    assert result.returncode == 1
    assert "pyboard v1.1:" in result.stderr
    assert "Feather" in result.stderr


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
