"""Which ports have a ribbon: each is asked once who it is, all at the same time."""

import errno
import math
import os
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from ribbonhost import wire
from ribbonhost.device.device import Device
from ribbonhost.errors import DeviceError, LinkError, NoAnswerError, RibbonError
from ribbonhost.link import BAUD, EMULATOR_SCHEME, Link, errno_of, open_link

PROBE_S = 0.3
"""So long a port is listened to, and all of them, opening included, take hardly longer."""

OPEN_S = 0.2
EMULATED_S = 3.0
"""An emulated ribbon is computed here, from its start on: it may take so much longer."""

PORTS_VARIABLE = "RIBBONHOST_PORTS"
"""Environment variable with further ports to ask, such as TCP bridges, separated by spaces."""


class PortState(StrEnum):
    """What a port turned out to be."""

    RIBBON = "ribbon"
    INCOMPATIBLE = "incompatible"
    OTHER = "no ribbon"
    BUSY = "busy"
    FORBIDDEN = "not permitted"
    FAILED = "not opened"


@dataclass(frozen=True)
class FoundPort:
    """A port that was asked.

    Attributes:
        url: what to open.
        state: what it turned out to be.
        what: why it is no ribbon that can be used, and what to do; empty for one that can.
        info: who the ribbon is; None where state is not RIBBON.
    """

    url: str
    state: PortState
    what: str = ""
    info: wire.Info | None = None

    @property
    def serial(self) -> str:
        """Serial number, 24 hexadecimal digits; empty where there is no ribbon."""
        return bytes(self.info.unique_id).hex() if self.info else ""


def serial_ports() -> list[str]:
    """Serial ports of this machine."""
    from serial.tools import list_ports

    return sorted(str(port.device) for port in list_ports.comports())


def extra_urls() -> list[str]:
    """Ports that RIBBONHOST_PORTS names."""
    return os.environ.get(PORTS_VARIABLE, "").split()


def candidate_urls() -> list[str]:
    """Serial ports of this machine, and those that RIBBONHOST_PORTS names."""
    return list(dict.fromkeys([*serial_ports(), *extra_urls()]))


def probe_ports(urls: Iterable[str], *, baud: int = BAUD, timeout_s: float = PROBE_S) -> list[FoundPort]:
    """Asks all ports at the same time, each with one GET_INFO frame and nothing else.

    A port that takes too long to open, as a Bluetooth one out of reach does, is given up.
    """
    urls = list(dict.fromkeys(urls))
    found: dict[str, FoundPort] = {}
    start_s = time.monotonic()
    asked = []
    for url in urls:
        patience_s = timeout_s + (EMULATED_S if url.startswith(EMULATOR_SCHEME) else 0.0)
        thread = threading.Thread(target=_probe, args=(url, baud, patience_s, found), daemon=True)
        thread.start()
        asked.append((thread, start_s + OPEN_S + patience_s))
    for thread, deadline_s in asked:
        thread.join(max(0.0, deadline_s - time.monotonic()))
    late = "could not be opened in time: out of reach, or switched off"
    return [found.get(url, FoundPort(url, PortState.FAILED, late)) for url in urls]


def ribbons_with(prefix: str, ports: Sequence[FoundPort]) -> dict[str, FoundPort]:
    """Ribbons whose serial number starts so, by serial number; of several ports of one the first."""
    fitting: dict[str, FoundPort] = {}
    for port in ports:
        if port.info and port.serial.startswith(prefix.lower()):
            fitting.setdefault(port.serial, port)
    return fitting


def _probe(url: str, baud: int, timeout_s: float, found: dict[str, FoundPort]) -> None:
    try:
        device = Device(open_link(url, baud=baud))
    except RibbonError as error:
        found[url] = FoundPort(url, _state_of(error), str(error).removeprefix(f"cannot open {url}: "))
        return
    found[url] = _ask(device, timeout_s)
    device.close()  # a TCP port takes its time for this: what was found does not wait for it


def _ask(device: Device, timeout_s: float) -> FoundPort:
    url = device.name
    try:
        return FoundPort(url, PortState.RIBBON, info=device.handshake(timeout_s, repeat_s=math.inf))
    except NoAnswerError:
        return FoundPort(url, PortState.OTHER, _heard(device.link))
    except LinkError as error:
        return FoundPort(url, PortState.FAILED, str(error))
    except DeviceError as error:
        return FoundPort(url, PortState.INCOMPATIBLE, str(error))


def _state_of(error: RibbonError) -> PortState:
    number = errno_of(error)
    if number in (errno.EACCES, errno.EPERM):
        return PortState.FORBIDDEN
    return PortState.BUSY if number in (errno.EBUSY, errno.EAGAIN) else PortState.FAILED


def _heard(link: Link) -> str:
    if link.bytes_read == 0:
        return "sends nothing when asked who it is"
    return f"sends {link.bytes_read} bytes but not who it is: another device, or another speed (--baud)"
