"""Where the RAW readings for a calibration come from: a ribbon on a link, or a recording."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ribbonhost import wire
from ribbonhost.calibrate.readings import Readings, readings_of
from ribbonhost.calibrate.refusals import Reason, RefusedError
from ribbonhost.device import Device, Observer
from ribbonhost.device.calibration import StoredCalibration
from ribbonhost.errors import RecordingError, RibbonError, UsageError
from ribbonhost.record import Header, Received, RecordedRibbon, Recording


class Traffic:
    """An Observer that keeps the packets that a calibration needs until somebody takes them."""

    def __init__(self, also: Observer | None = None) -> None:
        """`also`: somebody else who is told all that this one is."""
        self.order = also.order if also else threading.Lock()
        self._also = also
        self._packets: deque[bytes] = deque()

    def received(self, packet: bytes, t_host_s: float) -> None:
        if self._also:
            self._also.received(packet, t_host_s)
        if packet and packet[0] in (wire.PacketId.RAW, wire.PacketId.STATUS, wire.PacketId.INFO):
            self._packets.append(packet)

    def sent(self, packet: bytes, t_host_s: float) -> None:
        if self._also:
            self._also.sent(packet, t_host_s)

    def spoiled(self, crc_errors: int, malformed: int, t_host_s: float) -> None:
        if self._also:
            self._also.spoiled(crc_errors, malformed, t_host_s)

    def lost(self, why: str, t_host_s: float) -> None:
        if self._also:
            self._also.lost(why, t_host_s)

    def back(self, port: str, t_host_s: float) -> None:
        if self._also:
            self._also.back(port, t_host_s)

    def take(self) -> list[bytes]:
        """What came since the last time."""
        return [self._packets.popleft() for _ in range(len(self._packets))]


class Collected:
    """What packets of one ribbon say, as they come.

    Attributes:
        info: the latest.
        temperatures_c: of STATUS packets.
    """

    def __init__(self) -> None:
        self.info: wire.Info | None = None
        self.temperatures_c: list[float] = []
        self._raws: list[wire.Raw] = []

    def add(self, packet: bytes) -> None:
        """Uses a packet; what cannot be decoded the device has counted."""
        with contextlib.suppress(wire.WireError):
            message, _ = wire.decode(packet)
            if isinstance(message, wire.Raw):
                self._raws.append(message)
            elif isinstance(message, wire.Info):
                self.info = message
            elif isinstance(message, wire.Status) and math.isfinite(message.temperature_c):
                self.temperatures_c.append(message.temperature_c)

    def forget(self) -> None:
        """Drops all readings, but not who the ribbon is."""
        self._raws.clear()
        self.temperatures_c.clear()

    def __len__(self) -> int:
        return len(self._raws)

    def readings(self) -> Readings:
        """All readings so far. Raises RecordingError if the ribbon never said who it is."""
        if self.info is None:
            raise RecordingError("the ribbon never said who it is, and without that its counts mean nothing")
        return readings_of(self.info, self._raws)


@contextlib.contextmanager
def raw_mode(device: Device, rate_hz: int) -> Iterator[None]:
    """The device sends RAW meanwhile; it is left with the rate and mode that it had."""
    info = device.info
    assert info is not None  # a device that was opened has answered
    try:
        device.command(wire.CommandCode.SET_RATE, min(rate_hz, info.rate_max_hz))
        device.command(wire.CommandCode.SET_MODE, int(wire.Mode.RAW))
        device.handshake()
        yield
    finally:
        with contextlib.suppress(RibbonError):
            device.command(wire.CommandCode.SET_MODE, int(info.mode))
            device.command(wire.CommandCode.SET_RATE, info.rate_hz)


def collect_for(device: Device, traffic: Traffic, seconds: float, rate_hz: int) -> Collected:
    """RAW readings of a ribbon for a while. Raises LinkError and DeviceError."""
    collected = Collected()
    with raw_mode(device, rate_hz):
        collected.info = device.info
        traffic.take()
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            time.sleep(0.05)
            if device.lost:
                raise device.lost
            for packet in traffic.take():
                collected.add(packet)
    return collected


def header_of_one(device: Device, stored: StoredCalibration, rate_hz: int, version: str) -> Header:
    """The header of a recording of one ribbon, which uses the calibration `stored`."""
    info = device.info
    assert info is not None  # a device that was opened has answered
    ribbon = RecordedRibbon(
        label=device.name,
        serial=device.serial,
        channel=0,
        port=device.name,
        node_count=info.node_count,
        pitch_m=info.pitch_m,
        firmware=".".join(str(number) for number in info.firmware_version),
        calibration=(stored.sequence, stored.crc32),
        calibration_record=stored.record,
    )
    return Header(
        ribbons=(ribbon,),
        comb="",
        rate_hz=rate_hz,
        method="spline",
        wall_offset_ns=time.time_ns() - time.monotonic_ns(),
        host_version=version,
        wire_version=wire.WIRE_VERSION,
        schema_hash=wire.SCHEMA_HASH,
    )


@dataclass(frozen=True)
class Recorded:
    """One ribbon of a recording; in_use: the calibration that it used; None if that was not recorded."""

    serial: str
    collected: Collected
    in_use: wire.Calibration | None


def read_recording(path: Path, serial: str) -> Recorded:
    """The RAW readings of a ribbon in a recording; serial: of the ribbon, or empty if there is only one.

    Raises RecordingError, UsageError, and RefusedError if the recording is of other ribbons.
    """
    recording = Recording(path)
    channels = {r.channel: r.serial for r in recording.header.ribbons if r.channel is not None}
    there = " and ".join(channels.values())
    if serial and serial not in channels.values():
        raise RefusedError(
            Reason.OTHER_RIBBON,
            f"{path} is of ribbon {there}, and this one is {serial}: its sensors are others; record this one",
        )
    if not serial and len(channels) > 1:
        raise UsageError(f"{path} holds ribbons {there}: name the one that is meant (DEVICE or --serial)")
    channel, found = next(item for item in channels.items() if not serial or item[1] == serial)
    collected = Collected()
    for item in recording.items():
        if isinstance(item, Received) and item.ribbon == channel:
            collected.add(item.packet)
    if len(collected) == 0:
        raise RecordingError(f"{path} holds no RAW packets of ribbon {found}, which a calibration is made of")
    return Recorded(found, collected, recording.calibrations().get(found))
