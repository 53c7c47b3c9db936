"""Responders that differ from each other in what the protocol leaves to a device."""

from __future__ import annotations

import dataclasses
from typing import Any

from conformance.responder import Responder
from ribbonhost import wire
from ribbonhost.framing import encode_frame


class Short(Responder):
    """A short ribbon that scans slowly."""

    slot_count = 6
    rate_max_hz = 60


class Single(Responder):
    """The smallest ribbon at the smallest rate."""

    slot_count = 2
    rate_max_hz = 1


class PartsMissing(Responder):
    """Nothing answers in two slots."""

    absent_slots = (4, 9)


class ThreeAxes(Responder):
    """All axes of the magnetometers are used."""

    def identity_record(self) -> bytes:
        return dataclasses.replace(wire.Calibration.unpack(super().identity_record()), mag_axes=3).pack()


class Newer(Responder):
    """Speaks a later version: appended fields, and packets, values and parts not known here."""

    def send(self, packet: wire.Packet) -> None:
        self.send_content(wire.encode(packet) + b"\x2a\x00\x17")

    def info(self) -> wire.Info:
        info = super().info()
        parts = info.slots.part.copy()
        parts[3] = 200
        slots = dataclasses.replace(info.slots, part=parts)
        return dataclasses.replace(
            info, wire_version=wire.WIRE_VERSION + 1, schema_hash=0x12345678, board=77, slots=slots
        )

    def status(self) -> wire.Status:
        self.transmit(encode_frame(b"\x55 a packet of a later version"))
        return dataclasses.replace(super().status(), reset_cause=99)


class Running(Responder):
    """Has run for ten seconds when the link is opened, in the middle of a frame."""

    def __init__(self) -> None:
        super().__init__()
        while self.t_us < 10_000_000:
            self.read(0.01)
        self.outbox.clear()
        self.outbox.append((self.t_us, b"the end of a frame\0"))
        self.opened_s = self.now_s()


class OnASlowLink(Responder):
    """Gives up every tenth frame of the stream, and counts it."""

    streamed = 0

    def send(self, packet: wire.Packet) -> None:
        if isinstance(packet, wire.Orient | wire.OrientCompact | wire.Raw):
            self.streamed += 1
            if self.streamed % 10 == 0:
                self.frames_dropped += 1
                return
        super().send(packet)


class Overrunning(Responder):
    """Leaves a scan out now and then, and counts it."""

    def scan(self) -> None:
        if self.scans % 60 == 30:
            self.scan_start_us += self.period_us()
            self.overruns += 1
        super().scan()


class WithoutBootLoader(Responder):
    """Cannot enter DFU."""

    has_dfu = False


class SlowClock(Responder):
    """Timed by an internal RC oscillator."""

    clock_ratio = 0.99


class FarAway(Responder):
    """Behind a radio link."""

    latency_us = 60_000


class Delimiting(Responder):
    """Sends a delimiter before each frame too."""

    def transmit(self, frame: bytes) -> None:
        super().transmit(b"\0" + frame)


RIGHT_RESPONDERS: tuple[type[Any], ...] = (
    Responder,
    Short,
    Single,
    PartsMissing,
    ThreeAxes,
    Newer,
    Running,
    OnASlowLink,
    Overrunning,
    WithoutBootLoader,
    SlowClock,
    FarAway,
    Delimiting,
)
