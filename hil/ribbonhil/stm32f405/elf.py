"""Reads what is needed of a 32-bit ELF file: the image it loads, and where its symbols are."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from ribbonhost.errors import UsageError

FLASH_START = 0x08000000
FLASH_BYTES = 1 << 20

_HEADER = struct.Struct("<16sHHIIIIIHHHHHH")
_SEGMENT = struct.Struct("<8I")
_SECTION = struct.Struct("<10I")
_SYMBOL = struct.Struct("<IIIBBH")
_PT_LOAD = 1
_SHT_SYMTAB = 2
_STT_FUNC = 2
_EM_ARM = 40


class ElfError(UsageError):
    """The file is no ELF file for the MCU."""


@dataclass(frozen=True)
class Program:
    """What goes to the start of flash, the address of each symbol (Thumb bit cleared), and all functions by
    address: names of static ones may come more than once."""

    image: bytes
    symbols: dict[str, int]
    functions: list[tuple[int, str]]


def read_elf(path: Path) -> Program:
    """Raises ElfError for a file that is not an Arm ELF file with something to load into flash, or UsageError
    if it cannot be read."""
    data = _bytes_of(path)
    try:
        return _read(path, data)
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise ElfError(f"{path} is a damaged ELF file ({error})") from error


def _read(path: Path, data: bytes) -> Program:
    header = _HEADER.unpack_from(data)
    if header[0][:6] != b"\x7fELF\x01\x01" or header[2] != _EM_ARM:
        raise ElfError(f"{path} is not a 32-bit little-endian ELF file for Arm")
    segments_at, sections_at, segment_count, section_count = header[5], header[6], header[10], header[12]

    image = bytearray()
    for i in range(segment_count):
        kind, offset, _, address, n, *_ = _SEGMENT.unpack_from(data, segments_at + i * _SEGMENT.size)
        start = address - FLASH_START
        if kind != _PT_LOAD or n == 0 or not 0 <= start <= FLASH_BYTES - n:
            continue
        image.extend(b"\xff" * (start + n - len(image)))
        image[start : start + n] = data[offset : offset + n]
    if not image:
        raise ElfError(f"nothing in {path} goes to flash")

    sections = [_SECTION.unpack_from(data, sections_at + i * _SECTION.size) for i in range(section_count)]
    symbols: dict[str, int] = {}
    functions: set[tuple[int, str]] = set()
    for section in sections:
        if section[1] != _SHT_SYMTAB:
            continue
        names_at = sections[section[6]][4]
        for at in range(section[4], section[4] + section[5], _SYMBOL.size):
            name_at, value, _, info, *_ = _SYMBOL.unpack_from(data, at)
            name = data[names_at + name_at : data.index(b"\0", names_at + name_at)].decode()
            if name and not name.startswith("$"):
                symbols[name] = value & ~1
                if info & 15 == _STT_FUNC:
                    functions.add((value & ~1, name))
    return Program(bytes(image), symbols, sorted(functions))


def read_image(path: Path) -> bytes:
    """The bytes that go to the start of flash, out of a .bin or a .elf file.

    Raises ElfError, or UsageError if the file cannot be read."""
    data = _bytes_of(path)
    return read_elf(path).image if data.startswith(b"\x7fELF") else data


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
