"""Makes the ribbons of a comb scan at the same moments of the host's clock."""

import time

from ribbonhost import wire
from ribbonhost.clock import WRAP_US
from ribbonhost.device import Device
from ribbonhost.errors import DeviceError, LinkError

DRIFTED_S = 0.3e-3
"""Scans further apart than this are aligned again."""


class ScanAligner:
    """Gives several devices one moment at which a scan of each starts, and again when they drifted apart.

    Each device counts its periods on its own clock, so the moments of equal number are compared through the
    estimated clocks: what moves them apart is the difference of the drifts, and the estimates getting better.

    Attributes:
        free_running: devices that cannot be aligned, and what they answered.
    """

    def __init__(self, rate_hz: float) -> None:
        self.free_running: dict[Device, str] = {}
        self._rate_hz = rate_hz
        self._start_us: dict[Device, float] = {}
        self._restarts: dict[Device, int] = {}

    def is_aligned(self, device: Device) -> bool:
        """Whether the device was told when to scan, since its clock last started."""
        return self._restarts.get(device) == device.clock.restarts and device not in self.free_running

    def spread_s(self, devices: list[Device], t_host_s: float) -> float:
        """How far apart scans start at about t_host_s; infinite if a device was not told when to scan."""
        devices = self._alignable(devices)
        if not all(self.is_aligned(device) for device in devices):
            return float("inf")
        if len(devices) < 2:
            return 0.0
        period_us = 1e6 / self._rate_hz
        first = devices[0]
        elapsed_us = first.clock.t_device_us(t_host_s) - self._start_us[first]
        count = round(elapsed_us / period_us)
        starts_s = [d.clock.t_host_s(self._start_us[d] + count * period_us) for d in devices]
        return max(starts_s) - min(starts_s)

    def align(self, devices: list[Device]) -> None:
        """Lets a scan of each device start at one moment, unless it refuses or is gone."""
        start_s = time.monotonic() + 0.5 / self._rate_hz
        for device in self._alignable(devices):
            restarts = device.clock.restarts
            start_us = device.clock.t_device_us(start_s)
            try:
                device.command(wire.CommandCode.SET_PHASE, round(start_us) % WRAP_US)
            except LinkError:
                continue
            except DeviceError as error:
                self.free_running[device] = str(error)
            else:
                self._start_us[device] = start_us
                self._restarts[device] = restarts

    def _alignable(self, devices: list[Device]) -> list[Device]:
        return [d for d in devices if d not in self.free_running and d.clock.synced and not d.lost]
