"""The link of a device that has none: it is recorded, or not there yet."""

from ribbonhost.errors import LinkLostError
from ribbonhost.link import BAUD, Link, OnBytes, OnLost


class _NoPort:
    """A port that nobody reads or writes."""

    in_waiting = 0

    def read(self, size: int = 1, /) -> bytes:
        raise EOFError("there is no port")

    def write(self, data: bytes, /) -> int:
        raise OSError("there is no port")

    def close(self) -> None:
        pass


class NoLink(Link):
    """Reads nothing; one that is `lost` says so as soon as it is started."""

    def __init__(self, name: str, *, baud: int = BAUD, lost: LinkLostError | None = None) -> None:
        super().__init__(_NoPort(), name, baud)
        self.lost = lost

    def start(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """See Link."""
        if self.lost:
            on_lost(self.lost)
