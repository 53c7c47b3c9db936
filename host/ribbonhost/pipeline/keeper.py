"""Keeps the devices of a stream in order: set up, clocks known, scans aligned, set up again after a reset."""

import contextlib
import random
import threading
import time
from collections.abc import Callable, Sequence

from ribbonhost import wire
from ribbonhost.device import Device
from ribbonhost.errors import DeviceError, LinkError, LinkLostError
from ribbonhost.pipeline.phase import DRIFTED_S, ScanAligner
from ribbonhost.pipeline.raw_link import DropWatch, why_not

SYNC_PINGS = 20
SYNC_S = 2.0
PING_S = 0.25
FAST_PING_S = 0.02
ALIGN_S = 1.0
TICK_S = 0.02
AGAIN_S = 1.0
"""So long after a device could not be set up again it is tried once more."""


class Keeper:
    """Talks to the devices of a stream, on a thread of its own once started.

    Attributes:
        aligner: makes the scans start together.
    """

    def __init__(
        self,
        devices: Sequence[Device],
        rate_hz: int,
        on_event: Callable[[Device, str], None],
        *,
        raw: bool = False,
        on_joined: Callable[[Device], None] = lambda device: None,
    ) -> None:
        """`on_event` is told, in any thread, what happened to which device. raw: let those that can send RAW
        beside ORIENT. Devices that have not said who they are yet are set up when they have a link, of which
        `on_joined` is told."""
        self.aligner = ScanAligner(rate_hz)
        self._tell = on_event
        self._on_joined = on_joined
        self._absent = {device for device in devices if device.info is None}
        self._devices = [device for device in devices if device not in self._absent]
        self._rate_hz = rate_hz
        self._restarts: dict[Device, int] = {}
        self._again_due_s = dict.fromkeys(devices, 0.0)
        self._ping_due_s = dict.fromkeys(devices, 0.0)
        self._mute: set[Device] = set()
        self._drops = {device: DropWatch() for device in devices} if raw else {}
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="keeper", daemon=True)

    def prepare(self) -> dict[Device, DeviceError | LinkError]:
        """Makes all that are there scan at the rate, quietly and together; returns which cannot, and why."""
        failed: dict[Device, DeviceError | LinkError] = {}

        def for_all(act: Callable[[Device], object]) -> None:
            for device in self._devices:
                if device not in failed:
                    try:
                        act(device)
                    except (DeviceError, LinkError) as error:
                        failed[device] = error

        for_all(lambda device: device.command(wire.CommandCode.SET_MODE, 0))
        for_all(lambda device: device.command(wire.CommandCode.SET_RATE, self._rate_hz))
        for_all(lambda device: device.command(wire.CommandCode.GET_STATUS))
        for _ in range(SYNC_PINGS):
            for_all(lambda device: device.ping())
            time.sleep(FAST_PING_S)
        deadline_s = time.monotonic() + SYNC_S
        while not all(d.clock.synced or d in failed for d in self._devices) and time.monotonic() < deadline_s:
            for_all(lambda device: None if device.clock.synced else device.ping())
            time.sleep(FAST_PING_S)
        for_all(_require_sync)
        self._devices = [device for device in self._devices if device not in failed]
        for device in self._devices:
            self._check_raw(device)
        self._restarts = {device: device.clock.restarts for device in self._devices}
        self._align()
        return failed

    def start(self) -> dict[Device, DeviceError | LinkError]:
        """Lets the prepared devices send and keeps them in order from now on; returns those that refuse."""
        failed: dict[Device, DeviceError | LinkError] = {}
        for device in self._devices:
            try:
                device.command(wire.CommandCode.SET_MODE, self._mode(device))
            except (DeviceError, LinkError) as error:
                failed[device] = error
        self._devices = [device for device in self._devices if device not in failed]
        self._devices += self._absent
        self._restarts |= {device: device.clock.restarts for device in self._absent}
        self._thread.start()
        return failed

    def stop(self) -> None:
        """Ends the thread and quiets the devices that still listen."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        for device in self._devices:
            try:
                if not device.lost:
                    device.command(wire.CommandCode.SET_MODE, 0, timeout_s=0.5)
            except (DeviceError, LinkError) as error:
                self._tell(device, f"was not quieted: {error}")

    def _run(self) -> None:
        align_due_s = time.monotonic() + ALIGN_S
        while not self._stopping.wait(TICK_S):
            now_s = time.monotonic()
            for device in self._devices:
                if device.lost:
                    continue
                if now_s >= self._ping_due_s[device]:
                    self._ping(device, now_s)
                restarted = device.clock.synced and device.clock.restarts != self._restarts[device]
                if restarted and now_s >= self._again_due_s[device]:
                    self._set_up_again(device)
                elif device in self._drops and self._drops[device].is_too_slow(device.status):
                    self._spare(device)
            if now_s >= align_due_s:
                align_due_s = now_s + ALIGN_S
                if self.aligner.spread_s(self._devices, now_s) > DRIFTED_S:
                    self._align()

    def _ping(self, device: Device, now_s: float) -> None:
        # Not in step with the scans, so that some pings find the device idle.
        wait_s = PING_S * random.uniform(0.5, 1.5) if device.clock.synced else FAST_PING_S
        self._ping_due_s[device] = now_s + wait_s
        try:
            device.ping()
        except LinkError as error:
            if device not in self._mute:
                self._mute.add(device)
                self._tell(device, str(error))
        else:
            self._mute.discard(device)

    def _check_raw(self, device: Device) -> None:
        """Asks a device for RAW only if it can send it beside ORIENT."""
        if device in self._drops and (why := why_not(device, self._rate_hz)):
            del self._drops[device]
            self._tell(device, why)

    def _set_up_again(self, device: Device) -> None:
        restarts = device.clock.restarts
        self.aligner.free_running.pop(device, None)
        joins = device in self._absent
        why = "it was absent" if joins else "its clock started anew"
        try:
            if joins:
                device.handshake()
                self._check_raw(device)
            device.command(wire.CommandCode.SET_RATE, self._rate_hz)
            device.command(wire.CommandCode.SET_MODE, self._mode(device))
        except LinkLostError:
            pass  # which is told already
        except (DeviceError, LinkError) as error:
            self._again_due_s[device] = time.monotonic() + AGAIN_S
            self._tell(device, f"{why}, and it cannot be set up{'' if joins else ' again'}: {error}")
        else:
            self._restarts[device] = restarts
            self._absent.discard(device)
            if joins:
                self._tell(device, "has joined")
                self._on_joined(device)
            else:
                self._tell(device, f"{why}, and it is set up again")

    def _mode(self, device: Device) -> int:
        return int(wire.Mode.ORIENT | wire.Mode.RAW if device in self._drops else wire.Mode.ORIENT)

    def _spare(self, device: Device) -> None:
        """Asks for less than its link cannot carry."""
        del self._drops[device]
        with contextlib.suppress(DeviceError, LinkError):  # it is gone, or will be set up again
            device.command(wire.CommandCode.SET_MODE, self._mode(device))
        self._tell(
            device,
            f"its link does not carry RAW beside ORIENT at {self._rate_hz} Hz: "
            "its motion is not estimated any more (a faster link, or a lower --rate)",
        )

    def _align(self) -> None:
        before = set(self.aligner.free_running)
        self.aligner.align(self._devices)
        for device in set(self.aligner.free_running) - before:
            self._tell(device, f"scans whenever it likes: {self.aligner.free_running[device]}")


def _require_sync(device: Device) -> None:
    if not device.clock.synced:
        raise DeviceError(f"{device.name} does not answer clock pings")
