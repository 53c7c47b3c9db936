"""What somebody who keeps a device's traffic is told of it."""

import threading
from typing import Protocol


class Observer(Protocol):
    """Told of all traffic of a device as it happens; must return at once and not raise.

    Attributes:
        order: held while a packet is told and used. Devices whose observers share it are used in the order
            in which their packets are told.
    """

    order: threading.Lock

    def received(self, packet: bytes, t_host_s: float) -> None:
        """An intact packet, type byte and fields, and when the host had read its last byte."""

    def sent(self, packet: bytes, t_host_s: float) -> None:
        """A packet that is about to be sent to the device."""

    def spoiled(self, crc_errors: int, malformed: int, t_host_s: float) -> None:
        """Frames that were no packets: how many there were since the link was opened."""

    def lost(self, why: str, t_host_s: float) -> None:
        """The link is gone."""

    def back(self, port: str, t_host_s: float) -> None:
        """There is a new link, on this port; the clock and the sequence start anew."""
