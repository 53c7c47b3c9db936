"""One ribbon on a link: who it is, what it sends, what it is told, and what its clock says."""

import contextlib
import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from ribbonhost import wire
from ribbonhost.clock import DeviceClock, extend_us
from ribbonhost.device.absences import Absences
from ribbonhost.device.counters import Counters, Counts
from ribbonhost.device.observer import Observer
from ribbonhost.device.pairing import Pairing
from ribbonhost.device.scans import Scan, ScanReader
from ribbonhost.errors import (
    CommandRefusedError,
    CommandTimeoutError,
    DeviceError,
    LinkLostError,
    NoAnswerError,
    WireVersionError,
)
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.link import BAUD, Link, open_link

HANDSHAKE_S = 2.0
REPEAT_S = 0.25
COMMAND_S = 1.0

PINGS_KEPT = 64

SIGMA_DRIFT: dict[int, float] = {
    wire.ClockSource.CRYSTAL: 1e-4,
    wire.ClockSource.INTERNAL_RC: 1e-2,
    wire.ClockSource.HOST: 1e-4,
}
"""How wrong a clock is expected to be, by what times it; anything else: as DeviceClock has it."""


@dataclass
class _Pending:
    done: threading.Event
    command: int
    ack: wire.Ack | None = None


class Device:
    """A ribbon on an open link.

    The link's thread does all decoding. In it `on_scan` is called with each usable scan, and `on_lost` once
    if the port vanishes; they must not raise, wait or send commands.

    Attributes:
        clock: converts its times.
        info, status: the latest packets; None before the first.
        restarts: how often the device announced itself anew without being asked: it was reset.
        absences: when its link was gone.
    """

    def __init__(self, link: Link, observer: Observer | None = None, *, serial: str = "") -> None:
        """`observer` is told of all traffic from now on. serial: its serial number, if it is known."""
        self.link = link
        self._expected_serial = serial
        self._observer = observer
        self._order = observer.order if observer else threading.Lock()
        self._spoiled = (0, 0)
        self.clock = DeviceClock()
        self.info: wire.Info | None = None
        self.status: wire.Status | None = None
        self.restarts = 0
        self.absences = Absences()
        self.on_scan: Callable[[Scan], None] | None = None
        self.on_lost: Callable[[LinkLostError], None] | None = None
        self._deframer = Deframer()
        self._counts = Counts()
        self._scans = ScanReader(self.clock, self._counts)
        self._pairing = Pairing(self._counts)
        self._packets = 0
        self._refusal: DeviceError | None = None
        self._info_came = threading.Event()
        self._infos_due = 0
        self._lock = threading.Lock()
        # A program before this one may have left answers on the link: another first tag keeps them apart.
        self._tag = random.randrange(1 << 16)
        self._pending: dict[int, _Pending] = {}
        self._pings: dict[int, int] = {}
        link.start(self._on_bytes, self._on_lost)

    @property
    def name(self) -> str:
        """What the user typed for its port, or where it was found again."""
        return self.link.name

    @property
    def serial(self) -> str:
        """Its serial number: 24 hexadecimal digits; before the handshake what it is known to be, or empty."""
        return bytes(self.info.unique_id).hex() if self.info else self._expected_serial

    @property
    def rate_hz(self) -> float:
        """Scans a second, as last set or told; 0 before the handshake."""
        return self._scans.rate_hz

    @property
    def lost(self) -> LinkLostError | None:
        """Why it is gone; None while it is there."""
        return self.link.lost

    @property
    def same_schema(self) -> bool:
        """Whether it speaks exactly this host's schema, not just a compatible one."""
        return self.info is not None and self.info.schema_hash == wire.SCHEMA_HASH

    def counters(self) -> Counters:
        """What has been counted since the link was opened."""
        counters = self._counts.read()
        return replace(
            counters,
            crc_errors=self._deframer.crc_errors,
            malformed=counters.malformed + self._deframer.malformed,
        )

    def close(self) -> None:
        """Ends the link. The device goes on with what it does."""
        self.link.close()

    def resume(self, found: "Device") -> float:
        """Goes on over the link of `found`, which is this ribbon, on a port that was opened anew.

        Its clock and its sequence start anew; it must be set up again. `found` is not to be used any more.
        Returns for how long it was gone, seconds. Raises LinkLostError, with nothing changed, if the port is
        gone again.
        """
        away_s = 0.0

        def take_over() -> None:
            nonlocal away_s
            found._deframer.crc_errors = self._deframer.crc_errors
            found._deframer.malformed = self._deframer.malformed
            self._deframer = found._deframer
            with self._order:
                t_host_s = time.monotonic()
                if self._observer:
                    self._observer.back(found.name, t_host_s)
                away_s = self._start_anew(t_host_s)
                self.link = found.link

        found.link.hand_over(take_over, self._on_bytes, self._on_lost)
        with contextlib.suppress(LinkLostError):  # of which on_lost will tell
            self._send_command(self._next_tag(), wire.CommandCode.GET_INFO, 0, b"")
        return away_s

    def _start_anew(self, t_host_s: float) -> float:
        """There is a new link; returns for how long there was none."""
        self.clock.restart()
        self._scans.restart()
        self._pairing.restart()
        with self._lock:
            self._pings.clear()
        self._infos_due = 0
        return self.absences.end(t_host_s)

    def handshake(self, timeout_s: float = HANDSHAKE_S, *, repeat_s: float = REPEAT_S) -> wire.Info:
        """Asks who the device is, every repeat_s; it may be streaming meanwhile.

        Raises NoAnswerError with what was tried, WireVersionError if it needs another host, DeviceError if
        its INFO cannot be, LinkLostError if it vanishes.
        """
        deadline_s = time.monotonic() + timeout_s
        asked = 0
        self._info_came.clear()
        while not self._info_came.is_set() and self._refusal is None:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                raise NoAnswerError(self._silence(timeout_s, asked))
            self._send_command(self._next_tag(), wire.CommandCode.GET_INFO, 0, b"")
            asked += 1
            self._info_came.wait(min(repeat_s, left_s))
            if self.lost:
                raise self.lost
        if self._refusal:
            raise self._refusal
        assert self.info is not None
        return self.info

    def command(
        self,
        code: wire.CommandCode,
        argument: int = 0,
        data: bytes = b"",
        *,
        timeout_s: float = COMMAND_S,
    ) -> wire.Ack:
        """Sends a command, repeated every REPEAT_S until it is acknowledged.

        Raises CommandRefusedError if the code is not ok, CommandTimeoutError if none comes, LinkLostError.
        Not to be called from `on_scan`.
        """
        tag = self._next_tag()
        pending = self._pending[tag] = _Pending(threading.Event(), code)
        deadline_s = time.monotonic() + timeout_s
        try:
            while not pending.done.is_set():
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    raise CommandTimeoutError(
                        f"{self.name} did not acknowledge {code.name.lower()} within {timeout_s:g} s"
                    )
                self._send_command(tag, code, argument, data)
                pending.done.wait(min(REPEAT_S, left_s))
                if self.lost:
                    raise self.lost
        finally:
            del self._pending[tag]
        if pending.ack is None:
            raise LinkLostError(f"{self.name} vanished before it acknowledged {code.name.lower()}")
        if pending.ack.code != wire.AckCode.OK:
            raise CommandRefusedError(
                f"{self.name} refused {code.name.lower()} {argument}: {_ack_name(pending.ack.code)}",
                pending.ack.code,
            )
        return pending.ack

    def ping(self) -> None:
        """Sends one clock ping; the answer, if one comes, improves `clock`. Raises LinkLostError."""
        self._send(wire.ClockPing(tag=self._next_tag(), t_host_us=int(time.monotonic() * 1e6)))

    def _next_tag(self) -> int:
        with self._lock:
            self._tag = (self._tag + 1) % (1 << 16)
            return self._tag

    def _send(self, packet: wire.Packet) -> None:
        encoded = wire.encode(packet)
        if self._observer:
            self._observer.sent(encoded, time.monotonic())
        self._expect_answer(packet)
        self.link.write(encode_frame(encoded))

    def _send_command(self, tag: int, code: wire.CommandCode, argument: int, data: bytes) -> None:
        self._send(wire.Command(tag=tag, command=code, argument=argument, data=data))

    def _expect_answer(self, sent: wire.Packet) -> None:
        if isinstance(sent, wire.ClockPing):
            with self._lock:
                while len(self._pings) >= PINGS_KEPT:
                    del self._pings[next(iter(self._pings))]
                self._pings[sent.tag] = sent.t_host_us
        elif isinstance(sent, wire.Command) and sent.command == wire.CommandCode.GET_INFO:
            self._infos_due += 1

    def _silence(self, timeout_s: float, asked: int) -> str:
        """What was tried in vain, and what did come."""
        tried = f"{self.name} was asked {asked} times in {timeout_s:g} s who it is"
        counters = self.counters()
        if self.link.bytes_read == 0:
            return f"{tried} and sent nothing: is the ribbon powered and is this its port?"
        if self._packets == 0:
            return (
                f"{tried} and sent {self.link.bytes_read} bytes but no packet "
                f"({counters.crc_errors} CRC errors, {counters.malformed} malformed): "
                f"another kind of device, or another speed (--baud, {BAUD} unless given)"
            )
        return (
            f"{tried} and sent {self._packets} packets but never INFO ({counters.crc_errors} CRC errors): "
            "does the link carry bytes both ways?"
        )

    def _on_lost(self, error: LinkLostError) -> None:
        with self._order:
            t_host_s = time.monotonic()
            if self._observer:
                self._observer.lost(str(error), t_host_s)
            self.absences.begin(t_host_s)
            if self.on_lost:
                self.on_lost(error)
        self._info_came.set()
        for pending in tuple(self._pending.values()):
            pending.done.set()

    def _on_bytes(self, data: bytes, t_host_s: float) -> None:
        for packet in self._deframer.feed(data):
            with self._order:
                if self._observer:
                    self._observer.received(packet, t_host_s)
                self.receive(packet, t_host_s)
        spoiled = self._deframer.crc_errors, self._deframer.malformed
        if self._observer and spoiled != self._spoiled:
            self._spoiled = spoiled
            self._observer.spoiled(*spoiled, t_host_s)

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
                self._check_version(packet[1], packet[2])
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
        self._check_version(info.wire_version, info.oldest_host_version)
        if self._refusal is None and (fault := _fault_of(info)):
            self._refusal = DeviceError(f"{self.name} says of itself what cannot be: {fault}")
        if self._refusal:
            self._info_came.set()
            return
        if self._infos_due > 0:
            self._infos_due -= 1
        else:
            self.restarts += 1
            self.clock.restart()
            self._scans.restart()
            self._pairing.restart()
        self.info = info
        self._expect(info.mode)
        self._scans.rate_hz = float(info.rate_hz)
        self._info_came.set()

    def _check_version(self, wire_version: int, oldest_host_version: int) -> None:
        if oldest_host_version > wire.WIRE_VERSION:
            self._refusal = WireVersionError(
                f"{self.name} speaks wire version {wire_version} and needs a host that speaks at least "
                f"{oldest_host_version}; this one speaks {wire.WIRE_VERSION}: install a later ribbonhost"
            )
            self._info_came.set()

    def _on_ack(self, ack: wire.Ack) -> None:
        pending = self._pending.get(ack.tag)
        if pending is None or pending.command != ack.command:
            # The answer to a repeated command comes twice, and that to get_info is awaited as INFO.
            if ack.command != wire.CommandCode.GET_INFO:
                self._counts.add("unexpected")
            return
        if ack.command == wire.CommandCode.SET_RATE and ack.code == wire.AckCode.OK:
            self._scans.rate_hz = float(ack.value)
        if ack.command == wire.CommandCode.SET_MODE and ack.code == wire.AckCode.OK:
            self._expect(ack.value)
        pending.ack = ack
        pending.done.set()

    def _on_pong(self, pong: wire.ClockPong, t_host_s: float) -> None:
        if self._pings.get(pong.tag) != pong.t_host_us:
            self._counts.add("unexpected")
            return
        with self._lock:
            del self._pings[pong.tag]
        t2_us = self.clock.extend(pong.t_receive_us, t_host_s)
        t3_us = extend_us(pong.t_transmit_us, t2_us)
        if not self.clock.add_exchange(pong.t_host_us * 1e-6, t2_us, t3_us, t_host_s):
            self._counts.add("clock_jumps")


def open_device(url: str, *, baud: int = BAUD, observer: Observer | None = None) -> Device:
    """Opens a link and makes sure that a ribbon answers. Raises UsageError, LinkError and DeviceError."""
    device = Device(open_link(url, baud=baud), observer)
    try:
        device.handshake()
    except BaseException:
        device.close()
        raise
    return device


def _fault_of(info: wire.Info) -> str:
    """What in an INFO cannot be; empty if all can."""
    if not 0.001 <= info.pitch_m <= 1.0:
        return f"a pitch of {info.pitch_m:g} m"
    if info.node_count < 2 or 2 * info.node_count > len(info.slots):
        return f"{info.node_count} nodes on {len(info.slots)} slots"
    if not 1 <= info.rate_hz <= info.rate_max_hz:
        return f"a rate of {info.rate_hz} Hz where at most {info.rate_max_hz} are possible"
    return ""


def _ack_name(code: int) -> str:
    try:
        return wire.AckCode(code).name.lower()
    except ValueError:
        return f"code {code}"
