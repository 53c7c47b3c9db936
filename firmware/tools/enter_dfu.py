"""Asks a running ribbon to start its boot loader, over the link that it is used by."""

from __future__ import annotations

from dataclasses import dataclass


class NotAskedError(Exception):
    """No ribbon was asked, or it refused; the message says why and what to do."""


@dataclass(frozen=True)
class RunningRibbon:
    """A ribbon that answers on a port; board as in `make BOARD=...`."""

    url: str
    serial: str
    board: str


def running_ribbons(baud: int) -> list[RunningRibbon]:
    """The ribbons on the serial ports of this machine; none where ribbonhost is not installed."""
    try:
        from ribbonhost.device.discovery import probe_ports, serial_ports
        from ribbonhost.wire import Board
    except ImportError:
        return []
    return [
        RunningRibbon(port.url, port.serial, Board(port.info.board).name.lower())
        for port in probe_ports(serial_ports(), baud=baud)
        if port.info and port.info.board in set(Board)
    ]


def enter_dfu(url: str, board: str, baud: int) -> str:
    """Asks the ribbon at a port, which must run on this board; returns its serial number.

    Raises NotAskedError.
    """
    try:
        from ribbonhost.device import open_device
        from ribbonhost.errors import RibbonError
        from ribbonhost.wire import ENTER_DFU_KEY, Board, CommandCode
    except ImportError as error:
        raise NotAskedError("LINK needs ribbonhost: type `make flash` in the project's own folder") from error
    try:
        device = open_device(url, baud=baud)
        try:
            found = Board(device.info.board) if device.info and device.info.board in set(Board) else None
            if found is None or found.name.lower() != board:
                other = "another board" if found is None else found.name.lower()
                raise NotAskedError(
                    f"The ribbon at {url} runs on {other}, this image is for {board}: make flash BOARD=..."
                )
            device.command(CommandCode.ENTER_DFU, ENTER_DFU_KEY)
        finally:
            device.close()
    except RibbonError as error:
        raise NotAskedError(f"The ribbon at {url} did not start its boot loader: {error}") from error
    return device.serial
