"""How each board wires the MCU: pins as on its header, after its schematic, not after the firmware."""

from __future__ import annotations

from dataclasses import dataclass

from ribbonhost.errors import UsageError


@dataclass(frozen=True)
class Wiring:
    """Pins by name ("PA5"), the USART that the link is on, and the crystal (0 Hz: none)."""

    spi_sck: str
    spi_miso: str
    spi_mosi: str
    sel_clk: str
    sel_data: str
    link_usart: int
    link_tx: str
    link_rx: str
    led: str
    crystal_hz: int


BOARDS = {
    "pyboard_v11": Wiring(
        spi_sck="PA5",
        spi_miso="PA6",
        spi_mosi="PA7",
        sel_clk="PC4",
        sel_data="PC5",
        link_usart=2,
        link_tx="PA2",
        link_rx="PA3",
        led="PB4",
        crystal_hz=12_000_000,
    ),
    "feather_f405": Wiring(
        spi_sck="PA5",
        spi_miso="PA6",
        spi_mosi="PA7",
        sel_clk="PC4",
        sel_data="PC5",
        link_usart=3,
        link_tx="PB10",
        link_rx="PB11",
        led="PC1",
        crystal_hz=12_000_000,
    ),
}


def check_board(name: str) -> None:
    """Raises UsageError if there is no such board."""
    if name not in BOARDS:
        raise UsageError(f"There is no board {name}: there are {', '.join(BOARDS)}")


def pin_number(name: str) -> int:
    """16 * port + number, port A being 0."""
    return 16 * (ord(name[1]) - ord("A")) + int(name[2:])
