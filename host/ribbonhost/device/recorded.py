"""A device of which only a recording is there: used by the same code as one on a link."""

from ribbonhost import wire
from ribbonhost.device.device import Device
from ribbonhost.device.no_link import NoLink
from ribbonhost.errors import LinkLostError


class RecordedDevice(Device):
    """Takes what an Observer was told, in the same order, in one thread; says what the device said."""

    def __init__(self, name: str) -> None:
        super().__init__(NoLink(name))

    def send_again(self, packet: bytes) -> None:
        """What the host sent to it then. Raises WireError for a packet that is none."""
        message, _ = wire.decode(packet)
        self._questions.sent(message)
        if isinstance(message, wire.Command):
            self._questions.ask(message.tag, message.command)

    def spoil(self, crc_errors: int, malformed: int) -> None:
        """How many frames were no packets until then."""
        self._deframer.crc_errors, self._deframer.malformed = crc_errors, malformed

    def lose(self, why: str, t_host_s: float) -> None:
        """Its link was gone from then on."""
        self.link.lost = LinkLostError(why)
        self.absences.begin(t_host_s)
        if self.on_lost:
            self.on_lost(self.link.lost)

    def come_back(self, port: str, t_host_s: float) -> None:
        """It was there again, on a port of this name."""
        self.link.name, self.link.lost = port, None
        self._start_anew(t_host_s)
