"""Finds ribbons again whose ports vanished, by their serial numbers, wherever they come back."""

import threading
import time
from collections.abc import Callable, Sequence

from ribbonhost.device.device import Device, open_device
from ribbonhost.device.discovery import extra_urls, serial_ports
from ribbonhost.errors import RibbonError

SEEK_S = 0.25
"""How often it is looked whether a port is back."""

NEW_PORT_S = 5.0
"""So long a port that appeared while a ribbon is away is asked: a ribbon that just got power is not quick."""


class Seeker:
    """Asks ports, while a device is lost, until it answers; then the device goes on over the new link.

    Asked are the ports that lost devices had, those of RIBBONHOST_PORTS that no device has, and those that
    appear meanwhile, as a USB cable may come back under another name. Other ports are left alone: to open one
    restarts some boards. Each port is asked in a thread of its own, for a Bluetooth port out of reach can
    take long to say so.
    """

    def __init__(self, devices: Sequence[Device], on_back: Callable[[Device, float], None]) -> None:
        """`on_back` is told, in any thread, which device is back and for how many seconds it was away."""
        self._devices = {device.serial: device for device in devices}
        self._on_back = on_back
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
            lost = [device for device in self._devices.values() if device.lost]
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
        used = {device.name for device in self._devices.values() if not device.lost}
        urls = dict.fromkeys([*(device.name for device in lost), *new, *extra_urls()])
        return [url for url in urls if url not in used]

    def _ask(self, url: str, baud: int) -> None:
        with self._lock:
            if url in self._asking:
                return
            self._asking.add(url)
        threading.Thread(target=self._try, args=(url, baud), name=f"seek {url}", daemon=True).start()

    def _try(self, url: str, baud: int) -> None:
        try:
            found = open_device(url, baud=baud)
        except RibbonError:
            pass  # not yet, or somebody else
        else:
            self._bring_back(found)
        finally:
            with self._lock:
                self._asking.discard(url)

    def _bring_back(self, found: Device) -> None:
        with self._lock:
            device = self._devices.get(found.serial)
            if device is None or not device.lost or self._stopping.is_set():
                device = None
            else:
                try:
                    away_s = device.resume(found)
                except RibbonError:  # gone again
                    device = None
        if device is None:
            found.close()
        else:
            self._on_back(device, away_s)
