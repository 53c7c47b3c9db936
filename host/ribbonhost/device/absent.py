"""A ribbon that belongs to a stream and is not there yet: its device waits for a link."""

from ribbonhost.device.device import Device
from ribbonhost.device.no_link import NoLink
from ribbonhost.device.observer import Observer
from ribbonhost.errors import LinkLostError
from ribbonhost.link import BAUD


def absent_device(
    serial: str, port: str = "", *, baud: int = BAUD, observer: Observer | None = None
) -> Device:
    """A device whose link is lost from the beginning, which a Seeker makes go on over the link it finds.

    serial: its serial number; empty where only the port is known that it is expected on.
    """
    who = f"ribbon {serial}" if serial else f"the ribbon on {port}"
    return Device(NoLink(port, baud=baud, lost=LinkLostError(f"{who} is not there")), observer, serial=serial)
