"""Writes an image into the one board that is in DFU mode, reads it back, and starts it."""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from dfu_file import FLASH_START, USB_PRODUCT, USB_VENDOR

NO_BOARD = """No board is in DFU mode (looked for USB device {device}). Plug the board into USB and
  pyboard v1.1:       connect DFU to 3V3, press RST, disconnect DFU
  Feather STM32F405:  connect B0 to 3.3V, press RESET, disconnect B0
  a running ribbon:   send it the command enter_dfu
On Linux without permission for the device: run again with sudo, or add a udev rule for {device}."""


class FlashError(Exception):
    """The board was not flashed; the message says why and what to do."""


def serials_in_dfu_mode(listing: str) -> list[str]:
    """Serial numbers of STM32 boot loaders in the output of `dfu-util --list`, each once."""
    device = f"{USB_VENDOR:04x}:{USB_PRODUCT:04x}"
    found = re.findall(rf'Found DFU: \[{device}\].*serial="([^"]*)"', listing)
    return list(dict.fromkeys(found))


def flash(image: bytes, dfu: Path, serial: str | None) -> str:
    """Flashes, verifies and starts the board; returns its DFU serial number. Raises FlashError."""
    program = shutil.which("dfu-util")
    if program is None:
        raise FlashError("dfu-util is not installed. Type: sudo apt-get install dfu-util")
    device = f"{USB_VENDOR:04x}:{USB_PRODUCT:04x}"

    def dfu_util(*arguments: str) -> str:
        result = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
        if result.returncode != 0:
            raise FlashError(f"dfu-util {' '.join(arguments)} failed:\n{result.stderr.strip()}")
        return result.stdout

    serials = serials_in_dfu_mode(dfu_util("--list"))
    if not serials:
        raise FlashError(NO_BOARD.format(device=device))
    if serial is None and len(serials) > 1:
        raise FlashError(f"{len(serials)} boards are in DFU mode: name one with SERIAL={'|'.join(serials)}")
    if serial is not None and serial not in serials:
        raise FlashError(f"No board with serial {serial} is in DFU mode, but {', '.join(serials)}")
    chosen = serial or serials[0]

    board = ("--device", device, "--alt", "0", "--serial", chosen)
    dfu_util(*board, "--download", str(dfu))
    with tempfile.TemporaryDirectory() as folder:
        read_back = Path(folder) / "read_back.bin"
        dfu_util(*board, "--dfuse-address", f"{FLASH_START:#010x}:{len(image)}", "--upload", str(read_back))
        if read_back.read_bytes() != image:
            raise FlashError("What was read back is not the image: flash again, or the flash is worn out")
        ignored = Path(folder) / "ignored.bin"
        dfu_util(*board, "--dfuse-address", f"{FLASH_START:#010x}:4:leave", "--upload", str(ignored))
    return chosen


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--serial", default=None, help="DFU serial number, if several boards are in DFU mode")
    parser.add_argument("image", type=Path, help="ribbon.bin; ribbon.dfu is looked for beside it")
    arguments = parser.parse_args()
    try:
        chosen = flash(
            arguments.image.read_bytes(), arguments.image.with_suffix(".dfu"), arguments.serial or None
        )
    except (FlashError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f"Board {chosen} flashed, verified and started")
    return 0


if __name__ == "__main__":
    sys.exit(main())
