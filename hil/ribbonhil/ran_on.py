"""What answered, emulated or not, told from what the device itself says: no pass is taken for another."""

from __future__ import annotations

import string
from dataclasses import dataclass
from enum import Enum
from typing import Any

from ribbonhost.wire import Board, Info

from ribbonhil.emulated_device import UNIQUE_ID_MARK

LOT_NUMBER = slice(5, 12)
"""Of the unique id of an STM32F405: seven characters (RM0090, "Unique device ID register")."""
LOT_CHARACTERS = frozenset((string.ascii_letters + string.digits + string.punctuation + " ").encode())


class Kind(Enum):
    """What can be at the other end of a link."""

    MODULE = "emulated module"
    IMAGE = "emulated image"
    HARDWARE = "hardware"
    UNKNOWN = "not known to be hardware"


def kind_of(info: Info) -> Kind:
    """What a device is, whatever its link looks like: a serial port or a socket may lead to an emulated one.

    Emulated devices have a mark in their unique id; that of an STM32F405 holds the number of a silicon lot. A
    device that has neither may be anything.
    """
    unique_id = bytes(info.unique_id)
    if info.board == Board.HOST:
        return Kind.MODULE
    if unique_id.endswith(UNIQUE_ID_MARK):
        return Kind.IMAGE
    # Every board but the host has an STM32F405.
    if info.board in set(Board) and LOT_CHARACTERS.issuperset(unique_id[LOT_NUMBER]):
        return Kind.HARDWARE
    return Kind.UNKNOWN


@dataclass(frozen=True)
class RanOn:
    """Who was tested, over which link."""

    url: str
    info: Info

    @property
    def kind(self) -> Kind:
        return kind_of(self.info)

    @property
    def serial(self) -> str:
        return bytes(self.info.unique_id).hex()

    @property
    def firmware(self) -> str:
        return ".".join(str(number) for number in self.info.firmware_version)

    @property
    def board(self) -> str:
        board = self.info.board
        return board.name.lower() if isinstance(board, Board) else f"board {board}"

    def __str__(self) -> str:
        who = {
            Kind.MODULE: f"emulated module, firmware {self.firmware}",
            Kind.IMAGE: f"emulated STM32F405 that runs the image {self.firmware} for {self.board}",
            Kind.HARDWARE: f"hardware: {self.board}, firmware {self.firmware}",
            Kind.UNKNOWN: f"a device not known to be hardware: {self.board}, firmware {self.firmware}, "
            "its serial number is not of the form of an STM32F405's",
        }[self.kind]
        return f"{who}, serial number {self.serial}, at {self.url}"

    def as_json(self) -> dict[str, Any]:
        """The object that reports have under "ran_on"."""
        info = self.info
        return {
            "kind": self.kind.value,
            "is_hardware": self.kind is Kind.HARDWARE,
            "description": str(self),
            "link": self.url,
            "serial": self.serial,
            "board": self.board,
            "firmware_version": self.firmware,
            "wire_version": info.wire_version,
            "schema_hash": f"{info.schema_hash:08x}",
            "slots": len(info.slots),
            "calibration_sequence": info.calibration_sequence,
        }
