"""Wraps an image into a DfuSe file (ST UM0391), which tells dfu-util where to write it.

dfu-util then erases only the sectors that the image covers: the calibration store stays."""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

FLASH_START = 0x08000000
USB_VENDOR, USB_PRODUCT = 0x0483, 0xDF11
DFUSE_VERSION = 0x011A


def dfu_file(image: bytes, address: int = FLASH_START) -> bytes:
    """The bytes of a DfuSe file with `image` as its only element, to be written at `address`."""
    element = struct.pack("<II", address, len(image)) + image
    target = struct.pack("<6sBI255sII", b"Target", 0, 1, b"ribbon", len(element), 1) + element
    prefix = struct.pack("<5sBIB", b"DfuSe", 1, 11 + len(target), 1)
    suffix = struct.pack("<HHHH3sB", 0xFFFF, USB_PRODUCT, USB_VENDOR, DFUSE_VERSION, b"UFD", 16)
    body = prefix + target + suffix
    return body + struct.pack("<I", zlib.crc32(body) ^ 0xFFFFFFFF)


def main() -> int:
    if len(sys.argv) != 3:
        print("usage: dfu_file.py IMAGE.bin OUT.dfu", file=sys.stderr)
        return 2
    Path(sys.argv[2]).write_bytes(dfu_file(Path(sys.argv[1]).read_bytes()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
