"""What the packets of a ribbon say: who it is, what it reads, and what its clock is."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable

from ribbonhost import wire
from ribbonhost.clock import DeviceClock, extend_us
from ribbonhost.device.counters import Counts
from ribbonhost.device.introduction import refusal_of, version_refusal
from ribbonhost.device.pairing import Pairing
from ribbonhost.device.questions import Questions
from ribbonhost.device.scans import Scan, ScanReader
from ribbonhost.errors import DeviceError

SIGMA_DRIFT: dict[int, float] = {
    wire.ClockSource.CRYSTAL: 1e-4,
    wire.ClockSource.INTERNAL_RC: 1e-2,
    wire.ClockSource.HOST: 1e-4,
}
"""How wrong a clock is expected to be, by what times it; anything else: as DeviceClock has it."""


class Receiver(ABC):
    """Takes the packets of one ribbon, in one thread.

    Attributes:
        clock: converts its times.
        info, status: the latest packets; None before the first.
        restarts: how often the device announced itself anew without being asked: it was reset.
        on_scan: called with each usable scan.
    """

    def __init__(self, serial: str) -> None:
        """serial: its serial number, if it is known; else empty."""
        self.clock = DeviceClock()
        self.info: wire.Info | None = None
        self.status: wire.Status | None = None
        self.restarts = 0
        self.on_scan: Callable[[Scan], None] | None = None
        self._expected_serial = serial
        self._counts = Counts()
        self._scans = ScanReader(self.clock, self._counts)
        self._pairing = Pairing(self._counts)
        self._questions = Questions()
        self._packets = 0
        self._refusal: DeviceError | None = None
        self._info_came = threading.Event()

    @property
    @abstractmethod
    def name(self) -> str:
        """What its port is called."""

    @property
    def serial(self) -> str:
        """Its serial number: 24 hexadecimal digits; before the handshake what it is known to be, or empty."""
        return bytes(self.info.unique_id).hex() if self.info else self._expected_serial

    @property
    def rate_hz(self) -> float:
        """Scans a second, as last set or told; 0 before the handshake."""
        return self._scans.rate_hz

    @property
    def same_schema(self) -> bool:
        """Whether it speaks exactly this host's schema, not just a compatible one."""
        return self.info is not None and self.info.schema_hash == wire.SCHEMA_HASH

    def restart(self) -> None:
        """Its clock and its sequence start anew."""
        self.clock.restart()
        self._scans.restart()
        self._pairing.restart()

    def receive(self, packet: bytes, t_host_s: float) -> None:
        """Uses a packet, type byte and fields, that was read at t_host_s; bad ones are counted.

        The link's thread does this. Whoever else does, as with a recording, must be alone in doing so.
        """
        self._packets += 1
        try:
            message, surplus = wire.decode(packet)
        except wire.UnknownPacketError:
            self._counts.add("unknown_packets")
            return
        except wire.MalformedPacketError:
            self._counts.add("malformed")
            if len(packet) >= 3 and packet[0] == wire.PacketId.INFO:
                self._refuse(version_refusal(self.name, packet[1], packet[2]))
            return
        self._counts.add("surplus_bytes", surplus)
        match message:
            case wire.Orient() | wire.OrientCompact():
                if self.info:
                    scan = self._scans.read(message, self.info.node_count, t_host_s)
                    if scan:
                        self._hand_on(self._pairing.take(scan))
            case wire.Ack():
                self._on_ack(message)
            case wire.ClockPong():
                self._on_pong(message, t_host_s)
            case wire.Info():
                self._on_info(message)
            case wire.Status():
                self.status = message
                self.clock.sigma_drift = SIGMA_DRIFT.get(message.clock_source, self.clock.sigma_drift)
            case wire.Raw():
                if self.info:
                    self._hand_on(self._pairing.take_raw(message, self.info.node_count, t_host_s))
            case _:
                self._counts.add("unknown_packets")

    def _hand_on(self, scans: list[Scan]) -> None:
        if self.on_scan:
            for scan in scans:
                self.on_scan(scan)

    def _expect(self, mode: int) -> None:
        """What the device sends after each scan."""
        orient = mode & (wire.Mode.ORIENT | wire.Mode.ORIENT_COMPACT)
        self._pairing.expect(bool(mode & wire.Mode.RAW and orient))

    def _on_info(self, info: wire.Info) -> None:
        self._refuse(refusal_of(self.name, info))
        if self._refusal:
            return
        if not self._questions.expects_info():
            self.restarts += 1
            self.restart()
        self.info = info
        self._expect(info.mode)
        self._scans.rate_hz = float(info.rate_hz)
        self._info_came.set()

    def _refuse(self, refusal: DeviceError | None) -> None:
        self._refusal = self._refusal or refusal
        if self._refusal:
            self._info_came.set()

    def _on_ack(self, ack: wire.Ack) -> None:
        question = self._questions.question_of(ack)
        if question is None:
            # The answer to a repeated command comes twice, and that to get_info is awaited as INFO.
            if ack.command != wire.CommandCode.GET_INFO:
                self._counts.add("unexpected")
            return
        if ack.command == wire.CommandCode.SET_RATE and ack.code == wire.AckCode.OK:
            self._scans.rate_hz = float(ack.value)
        if ack.command == wire.CommandCode.SET_MODE and ack.code == wire.AckCode.OK:
            self._expect(ack.value)
        question.ack = ack
        question.done.set()

    def _on_pong(self, pong: wire.ClockPong, t_host_s: float) -> None:
        if not self._questions.expects_pong(pong):
            self._counts.add("unexpected")
            return
        t2_us = self.clock.extend(pong.t_receive_us, t_host_s)
        t3_us = extend_us(pong.t_transmit_us, t2_us)
        if not self.clock.add_exchange(pong.t_host_us * 1e-6, t2_us, t3_us, t_host_s):
            self._counts.add("clock_jumps")
