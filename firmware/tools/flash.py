"""Writes an image into the one board that is in DFU mode, reads it back, and starts it.

If no board is, but a ribbon answers on a serial port, that is asked to start its boot loader.
"""

from __future__ import annotations

import argparse
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from dfu_file import FLASH_START, USB_PRODUCT, USB_VENDOR
from enter_dfu import NotAskedError, enter_dfu, running_ribbons

DEVICE = f"{USB_VENDOR:04x}:{USB_PRODUCT:04x}"
APPEARS_S = 10.0
LOOK_S = 0.3

INSTALL = {"Linux": "sudo apt-get install dfu-util", "Darwin": "brew install dfu-util"}

NO_BOARD = f"""No board is in DFU mode (looked for USB device {DEVICE}). Plug the board into USB and
  pyboard v1.1:       connect DFU to 3V3, press RST, disconnect DFU
  Feather STM32F405:  connect B0 to 3.3V, press RESET, disconnect B0
  a running ribbon:   make flash LINK=PORT asks it over its link; no serial port here has one"""

RULE = (
    f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{USB_VENDOR:04x}", ATTR{{idProduct}}=="{USB_PRODUCT:04x}", '
    'MODE="0660", GROUP="plugdev", TAG+="uaccess"'
)
FORBIDDEN = f"""A board is in DFU mode, but this user may not open USB device {DEVICE}.
Allow it with this udev rule; type once
  echo '{RULE}' | sudo tee /etc/udev/rules.d/50-stm32-dfu.rules
  sudo udevadm control --reload-rules && sudo udevadm trigger"""

NO_DRIVER = f"""A board is in DFU mode, but USB device {DEVICE} has no WinUSB driver:
  install it with Zadig (zadig.akeo.ie)"""

NOT_ON_USB = """Ribbon {serial} has started its boot loader, but no board in DFU mode appears on USB.
  Plug its USB socket into this computer (the link is another cable), and type make flash again.
  RST, or RESET, starts the old firmware."""


class FlashError(Exception):
    """The board was not flashed; the message says why and what to do."""


class DfuUtil:
    """The program dfu-util. Methods raise FlashError."""

    def __init__(self) -> None:
        program = shutil.which("dfu-util")
        if program is None:
            how = INSTALL.get(platform.system(), "see dfu-util.sourceforge.net")
            raise FlashError(f"dfu-util is not installed. Type: {how}")
        self._program = program

    def run(self, *arguments: str) -> str:
        """What it prints to either stream."""
        result = subprocess.run([self._program, *arguments], capture_output=True, text=True, check=False)
        said = result.stdout + result.stderr
        if f"Cannot open DFU device {DEVICE}" in said:
            raise FlashError(NO_DRIVER if "NOT_SUPPORTED" in said else FORBIDDEN)
        if result.returncode != 0:
            raise FlashError(f"dfu-util {' '.join(arguments)} failed:\n{result.stderr.strip()}")
        return said

    def serials(self) -> list[str]:
        """Serial numbers of the boards that are in DFU mode, each once."""
        found = re.findall(rf'Found DFU: \[{DEVICE}\].*serial="([^"]*)"', self.run("--list"))
        return list(dict.fromkeys(found))


def flash(image: bytes, dfu: Path, *, serial: str | None, board: str, link: str | None, baud: int) -> str:
    """Flashes, verifies and starts a board; says what was done.

    serial: of the board in DFU mode; None: the only one. board: that the image is for. link: of a ribbon to
    ask; None: the only one, if no board is in DFU mode. baud: of links. Raises FlashError.
    """
    dfu_util = DfuUtil()
    chosen = _chosen(dfu_util, serial, board, link, baud)
    at = ("--device", DEVICE, "--alt", "0", "--serial", chosen)
    dfu_util.run(*at, "--download", str(dfu))
    with tempfile.TemporaryDirectory() as folder:
        read_back = Path(folder) / "read_back.bin"
        dfu_util.run(*at, "--dfuse-address", f"{FLASH_START:#010x}:{len(image)}", "--upload", str(read_back))
        if read_back.read_bytes() != image:
            raise FlashError("What was read back is not the image: flash again, or the flash is worn out")
        ignored = Path(folder) / "ignored.bin"
        try:
            dfu_util.run(*at, "--dfuse-address", f"{FLASH_START:#010x}:4:leave", "--upload", str(ignored))
        except FlashError:
            # A board that starts at once does not answer any more, which dfu-util calls an error.
            return f"Board {chosen} flashed and verified; if it does not run, press RST"
    return f"Board {chosen} flashed, verified and started"


def _chosen(dfu_util: DfuUtil, serial: str | None, board: str, link: str | None, baud: int) -> str:
    """The DFU serial number of the board to flash; a ribbon that can be asked gets it into DFU mode."""
    serials = dfu_util.serials()
    if link is not None:
        return _asked(dfu_util, serials, link, board, baud)
    if serial is not None and serial not in serials:
        there = f", but {', '.join(serials)}" if serials else ""
        raise FlashError(f"No board with serial {serial} is in DFU mode{there}")
    if not serials:
        ribbons = [ribbon for ribbon in running_ribbons(baud) if ribbon.board == board]
        if not ribbons:
            raise FlashError(NO_BOARD)
        if len(ribbons) > 1:
            names = (f"  make flash LINK={one.url}   ribbon {one.serial}" for one in ribbons)
            several = f"No board is in DFU mode, and {len(ribbons)} ribbons run here. Name one:"
            raise FlashError("\n".join([several, *names]))
        return _asked(dfu_util, serials, ribbons[0].url, board, baud)
    if serial is None and len(serials) > 1:
        raise FlashError(f"{len(serials)} boards are in DFU mode: name one with SERIAL={'|'.join(serials)}")
    return serial or serials[0]


def _asked(dfu_util: DfuUtil, before: list[str], url: str, board: str, baud: int) -> str:
    """Asks a running ribbon; returns the DFU serial number of the board that appears then."""
    try:
        ribbon = enter_dfu(url, board, baud)
    except NotAskedError as error:
        raise FlashError(str(error)) from error
    print(f"Ribbon {ribbon} at {url} starts its boot loader", flush=True)
    deadline_s = time.monotonic() + APPEARS_S
    problem = FlashError(NOT_ON_USB.format(serial=ribbon))
    while time.monotonic() < deadline_s:
        try:
            new = [serial for serial in dfu_util.serials() if serial not in before]
        except FlashError as error:
            problem = error  # for a moment the system has not given the new device to this user yet
        else:
            if new:
                return new[0]
        time.sleep(LOOK_S)
    raise problem


def main() -> int:
    """Returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--serial", default="", help="DFU serial number, if several boards are in DFU mode")
    parser.add_argument(
        "--link", default="", help="port of a running ribbon that shall start its boot loader"
    )
    parser.add_argument("--board", required=True, help="what the image was built for")
    parser.add_argument("--baud", type=int, required=True, help="speed of a running ribbon's link")
    parser.add_argument("image", type=Path, help="ribbon.bin; ribbon.dfu is looked for beside it")
    arguments = parser.parse_args()
    try:
        done = flash(
            arguments.image.read_bytes(),
            arguments.image.with_suffix(".dfu"),
            serial=arguments.serial or None,
            board=arguments.board,
            link=arguments.link or None,
            baud=arguments.baud,
        )
    except (FlashError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("Stopped: the board may be half written; type make flash again", file=sys.stderr)
        return 130
    print(done)
    return 0


if __name__ == "__main__":
    sys.exit(main())
