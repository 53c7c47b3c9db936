"""Finds ribbons whose ports vanished, or that were not there yet, wherever they come up."""

import threading
import time
from collections.abc import Callable, Sequence

from ribbonhost.device.device import Device, open_device
from ribbonhost.device.discovery import extra_urls, serial_ports
from ribbonhost.errors import DeviceError, LinkError, NoAnswerError, RibbonError

SEEK_S = 0.25
"""How often it is looked whether a port is back."""

NEW_PORT_S = 5.0
"""So long a port that appeared while a ribbon is away is asked: a ribbon that just got power is not quick."""

REFUSED_S = 5.0
"""So long a port is left alone whose ribbon is of no use."""

Admit = Callable[[Device, Device], None]
OnRefused = Callable[[Device | None, str], None]


class Seeker:
    """Asks ports, while a device is lost, until it answers; then the device goes on over the new link.

    Asked are the ports that lost devices had, those that the user named, those of RIBBONHOST_PORTS that no
    device has, and those that appear meanwhile, as a USB cable may come back under another name. Other ports
    are left alone: to open one restarts some boards. Each port is asked in a thread of its own, for a
    Bluetooth port out of reach can take long to say so.
    """

    def __init__(
        self,
        devices: Sequence[Device],
        on_back: Callable[[Device, float], None],
        *,
        named: Sequence[str] = (),
        admit: Admit = lambda device, found: None,
        on_refused: OnRefused = lambda device, why: None,
    ) -> None:
        """`on_back` is told, in any thread, which device is back and for how many seconds it was away.

        named: ports that the user named and that had no ribbon. admit: is given a lost device and the one
        found that is the same ribbon, and raises DeviceError if it is not to be used; LinkError: not now.
        on_refused: told, once for each port, whose ribbon is of no use, None if it is nobody's, and why.
        """
        self._devices = list(devices)
        self._on_back = on_back
        self._named = tuple(named)
        self._admit = admit
        self._on_refused = on_refused
        self._refused: dict[str, tuple[str, float]] = {}
        """By port: why what is there is of no use, and until when the port is left alone."""
        self._seen_s: dict[str, float] = {}
        """Serial ports that are listed, and when they appeared; those from the start: never."""
        self._asking: set[str] = set()
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="seek", daemon=True)

    def start(self) -> None:
        """Begins to watch the devices."""
        self._thread.start()

    def stop(self) -> None:
        """Ends it. A port that is being asked is closed by itself, later."""
        with self._lock:
            self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        self._seen_s = dict.fromkeys(serial_ports(), -NEW_PORT_S)
        while not self._stopping.wait(SEEK_S):
            lost = [device for device in self._devices if device.lost]
            if not lost:
                continue
            for device in lost:
                device.link.close()  # a port that is still open comes back under another name
            for url in self._urls(lost):
                self._ask(url, lost[0].link.baud)

    def _urls(self, lost: Sequence[Device]) -> list[str]:
        now_s = time.monotonic()
        self._seen_s = {url: self._seen_s.get(url, now_s) for url in serial_ports()}
        new = [url for url, seen_s in self._seen_s.items() if now_s - seen_s < NEW_PORT_S]
        used = {device.name for device in self._devices if not device.lost}
        used |= {url for url, (_, until_s) in self._refused.items() if now_s < until_s}
        urls = dict.fromkeys([*(device.name for device in lost), *self._named, *new, *extra_urls()])
        return [url for url in urls if url and url not in used]

    def _ask(self, url: str, baud: int) -> None:
        with self._lock:
            if url in self._asking:
                return
            self._asking.add(url)
        threading.Thread(target=self._try, args=(url, baud), name=f"seek {url}", daemon=True).start()

    def _try(self, url: str, baud: int) -> None:
        try:
            found = open_device(url, baud=baud)
        except (LinkError, NoAnswerError):
            pass  # not yet, or no ribbon
        except RibbonError as error:
            self._refuse(url, None, str(error))
        else:
            self._bring_back(url, found)
        finally:
            with self._lock:
                self._asking.discard(url)

    def _bring_back(self, url: str, found: Device) -> None:
        device: Device | None = None
        why, away_s = "", None
        with self._lock:
            if not self._stopping.is_set():
                device = self._same(found)
                if device is None:
                    why = f"ribbon {found.serial} on {url} is none of this stream's: left out"
                elif device.lost:
                    try:
                        self._admit(device, found)
                        away_s = device.resume(found)
                    except LinkError:
                        pass  # gone again
                    except DeviceError as error:
                        why = str(error)
                elif url in self._named:
                    why = f"{url} is ribbon {found.serial}, which is on {device.name} already: left out"
        if away_s is not None and device:
            self._refused.pop(url, None)
            self._on_back(device, away_s)
            return
        found.close()
        if why:
            self._refuse(url, device, why)

    def _same(self, found: Device) -> Device | None:
        """The device that is this ribbon; else one of which only the port is known, and that is this one."""
        by_serial = (device for device in self._devices if device.serial == found.serial)
        by_port = (device for device in self._devices if not device.serial and device.name == found.name)
        return next(by_serial, next(by_port, None))

    def _refuse(self, url: str, device: Device | None, why: str) -> None:
        told = self._refused.get(url, ("", 0.0))[0]
        self._refused[url] = (why, time.monotonic() + REFUSED_S)
        if why != told and not self._stopping.is_set():
            self._on_refused(device, why)
