"""The bench that checks measure at: a device under test, and what it sent while it was left alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ribbonhost.clock import extend_us
from ribbonhost.wire import (
    Calibration,
    ClockPing,
    ClockPong,
    Info,
    Mode,
    Orient,
    OrientCompact,
    Raw,
    SlotReason,
    encode,
)

from ribbonhil.check.check import NotRunError
from ribbonhil.check.provoke import Provoker
from ribbonhil.check.readings import Readings, Scans, readings_of, scans_of
from ribbonhil.conformance.check import expect
from ribbonhil.conformance.client import Frame
from ribbonhil.conformance.device import Device, Recording

BITS_PER_BYTE = 10
"""On a serial line: a start bit, eight bits, a stop bit."""
FULL = 0.95
"""Share of a link that a stream may take; answers and STATUS need the rest."""
FRAMING_BYTES = 5
"""CRC, delimiter, and COBS codes of a frame of less than 508 bytes."""
LOADS = (Mode.ORIENT | Mode.RAW, Mode.RAW, Mode.ORIENT, Mode.ORIENT_COMPACT)
"""What a device may be told to send, the most first."""
UNCALIBRATED = (SlotReason.OUT_OF_RANGE, SlotReason.NOISY)
"""Reasons that come from comparing readings with each other and with the local field."""
PING_S = 0.1
REST_RATE_HZ = 100
REST_RATE_MIN_HZ = 10


@dataclass(frozen=True)
class Options:
    """What the user chose.

    seconds: of each recording. rates_hz: to test, none for 100 Hz and the device's largest. straight: the
    ribbon lies along a straight edge. baud: of the device's UART.
    """

    seconds: float = 5.0
    rates_hz: tuple[int, ...] = ()
    straight: bool = False
    baud: int = 921_600


class PingedDevice(Device):
    """A device whose clock is asked for all the while that frames are received."""

    def receive(self, duration_s: float) -> list[Frame]:
        since = self.mark()
        end_s = self.now_s() + duration_s
        while (left_s := end_s - self.now_s()) > 0.0:
            self.send(encode(ClockPing(self.next_tag(), round(self.now_s() * 1e6))))
            super().receive(min(left_s, PING_S))
        return self.log[since:]

    def exchanges(self) -> list[tuple[float, int, int, float]]:
        """T1, T2, T3, T4 of each ping that was answered: host, device (us, 64 bit), device, host."""
        found = []
        near_us = 0
        for frame in self.log:
            if isinstance(frame.packet, ClockPong):
                pong = frame.packet
                receive_us = near_us = extend_us(pong.t_receive_us, near_us or pong.t_receive_us)
                transmit_us = extend_us(pong.t_transmit_us, receive_us)
                found.append((pong.t_host_us * 1e-6, receive_us, transmit_us, frame.t_host_s))
        return found


class Bench:
    """What a check is given.

    Attributes:
        device: the device under test.
        options: what the user chose.
        provoker: what can make a fault; None if nothing can.
    """

    def __init__(self, device: PingedDevice, options: Options, provoker: Provoker | None = None) -> None:
        self.device = device
        self.options = options
        self.provoker = provoker

    @property
    def info(self) -> Info:
        """What the device said at first."""
        return self.device.info

    @property
    def rates_hz(self) -> tuple[int, ...]:
        """The rates to test, rising."""
        highest_hz = self.info.rate_max_hz
        wanted = self.options.rates_hz or (REST_RATE_HZ, highest_hz)
        return tuple(sorted({max(1, min(rate, highest_hz)) for rate in wanted}))

    @property
    def carried_hz(self) -> int:
        """The highest rate to test at which the link carries anything whole; a lower one if there is none."""
        rates_hz = (*reversed(self.rates_hz), *range(self.rates_hz[0], 0, -1))
        return next((rate for rate in rates_hz if self._fits(Mode.ORIENT_COMPACT, rate)), 1)

    def load(self, rate_hz: int) -> Mode:
        """The most that the link carries at a rate; ORIENT_COMPACT if it does not even carry that."""
        return next((mode for mode in LOADS if self._fits(mode, rate_hz)), Mode.ORIENT_COMPACT)

    def stream(self, rate_hz: int) -> Recording:
        """What the device sends at a rate when it sends as much as the link carries."""
        return self.device.record(rate_hz, self.load(rate_hz), self.options.seconds)

    def scans(self, rate_hz: int) -> Scans:
        """When the scans of that stream were. Raises NotRunError if there are too few to tell."""
        recording = self.stream(rate_hz)
        for kind in (Orient, Raw, OrientCompact):
            scans = scans_of(recording, kind)
            if len(scans.number) >= 3:
                return scans
        raise NotRunError(f"the device sent no three packets at {rate_hz} Hz")

    @cached_property
    def readings(self) -> Readings:
        """ORIENT and RAW of a ribbon at rest.

        Raises NotRunError if the link is too slow for both, or there are no readings.
        """
        both = Mode.ORIENT | Mode.RAW
        highest_hz = min(REST_RATE_HZ, self.info.rate_max_hz)
        carried = (rate for rate in range(highest_hz, 0, -1) if self._fits(both, rate))
        rate_hz = next(carried, 0)
        if rate_hz < min(REST_RATE_MIN_HZ, highest_hz):
            raise NotRunError(f"a link of {self.options.baud} baud does not carry ORIENT and RAW")
        return readings_of(self.device.record(rate_hz, both, self.options.seconds), self.info)

    def at_rest(self) -> Readings:
        """The same. Raises NotRunError also if the ribbon moved meanwhile."""
        moved = self.readings.moved()
        if moved:
            raise NotRunError(f"the ribbon moves ({moved}): lay it still, and start again")
        return self.readings

    @cached_property
    def calibration(self) -> Calibration:
        """The calibration record in use. Raises BrokenRuleError or WireError if it cannot be read."""
        calibration = Calibration.unpack(self.device.read_calibration())
        slots = len(self.info.slots)
        expect(len(calibration.slots) == slots, f"a calibration of {slots} slots", len(calibration.slots))
        return calibration

    @property
    def is_calibrated(self) -> bool:
        """Whether a calibration was ever stored."""
        return self.info.calibration_sequence > 0

    @property
    def well(self) -> tuple[SlotReason, ...]:
        """Reasons that are no fault of a slot: the errors of parts are not known before a calibration."""
        return (SlotReason.OK,) if self.is_calibrated else (SlotReason.OK, *UNCALIBRATED)

    def _fits(self, mode: Mode, rate_hz: int) -> bool:
        nodes, slots = self.info.node_count, len(self.info.slots)
        frames = {
            Mode.ORIENT: 8 + 7 * nodes,
            Mode.ORIENT_COMPACT: 8 + 5 * nodes,
            Mode.RAW: 21 + 7 * ((slots + 1) // 2) + 10 * (slots // 2),
        }
        per_scan = sum(size + FRAMING_BYTES for flag, size in frames.items() if flag in mode)
        return per_scan * rate_hz <= FULL * self.options.baud / BITS_PER_BYTE
