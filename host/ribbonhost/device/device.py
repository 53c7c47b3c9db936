"""One ribbon on a link: asked who it is, told what to do, and gone on with when the link is another."""

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from ribbonhost import wire
from ribbonhost.device.absences import Absences
from ribbonhost.device.counters import Counters
from ribbonhost.device.introduction import silence
from ribbonhost.device.observer import Observer
from ribbonhost.device.receiver import Receiver
from ribbonhost.errors import (
    CommandRefusedError,
    CommandTimeoutError,
    LinkLostError,
    NoAnswerError,
)
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.link import BAUD, Link, open_link

HANDSHAKE_S = 2.0
REPEAT_S = 0.25
COMMAND_S = 1.0


class Device(Receiver):
    """A ribbon on an open link.

    The link's thread does all decoding. In it `on_scan` is called with each usable scan, and `on_lost` once
    if the port vanishes; they must not raise, wait or send commands.

    Attributes:
        absences: when its link was gone.
    """

    def __init__(self, link: Link, observer: Observer | None = None, *, serial: str = "") -> None:
        """`observer` is told of all traffic from now on. serial: its serial number, if it is known."""
        super().__init__(serial)
        self.link = link
        self._observer = observer
        self._order = observer.order if observer else threading.Lock()
        self._spoiled = (0, 0)
        self.absences = Absences()
        self.on_lost: Callable[[LinkLostError], None] | None = None
        self._deframer = Deframer()
        link.start(self._on_bytes, self._on_lost)

    @property
    def name(self) -> str:
        """What the user typed for its port, or where it was found again."""
        return self.link.name

    @property
    def lost(self) -> LinkLostError | None:
        """Why it is gone; None while it is there."""
        return self.link.lost

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
            self._ask_info()
        return away_s

    def _start_anew(self, t_host_s: float) -> float:
        """There is a new link; returns for how long there was none."""
        self.restart()
        self._questions.restart()
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
                raise NoAnswerError(silence(self.link, self.counters(), self._packets, timeout_s, asked))
            self._ask_info()
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
        tag = self._questions.next_tag()
        question = self._questions.ask(tag, code)
        deadline_s = time.monotonic() + timeout_s
        try:
            while not question.done.is_set():
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    raise CommandTimeoutError(
                        f"{self.name} did not acknowledge {code.name.lower()} within {timeout_s:g} s"
                    )
                self._send_command(tag, code, argument, data)
                question.done.wait(min(REPEAT_S, left_s))
                if self.lost:
                    raise self.lost
        finally:
            self._questions.withdraw(tag)
        if question.ack is None:
            raise LinkLostError(f"{self.name} vanished before it acknowledged {code.name.lower()}")
        if question.ack.code != wire.AckCode.OK:
            raise CommandRefusedError(
                f"{self.name} refused {code.name.lower()} {argument}: {_ack_name(question.ack.code)}",
                question.ack.code,
            )
        return question.ack

    def ping(self) -> None:
        """Sends one clock ping; the answer, if one comes, improves `clock`. Raises LinkLostError."""
        self._send(wire.ClockPing(tag=self._questions.next_tag(), t_host_us=int(time.monotonic() * 1e6)))

    def _send(self, packet: wire.Packet) -> None:
        encoded = wire.encode(packet)
        if self._observer:
            self._observer.sent(encoded, time.monotonic())
        self._questions.sent(packet)
        self.link.write(encode_frame(encoded))

    def _send_command(self, tag: int, code: wire.CommandCode, argument: int, data: bytes) -> None:
        self._send(wire.Command(tag=tag, command=code, argument=argument, data=data))

    def _ask_info(self) -> None:
        self._send_command(self._questions.next_tag(), wire.CommandCode.GET_INFO, 0, b"")

    def _on_lost(self, error: LinkLostError) -> None:
        with self._order:
            t_host_s = time.monotonic()
            if self._observer:
                self._observer.lost(str(error), t_host_s)
            self.absences.begin(t_host_s)
            if self.on_lost:
                self.on_lost(error)
        self._info_came.set()
        self._questions.give_up()

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


def open_device(url: str, *, baud: int = BAUD, observer: Observer | None = None) -> Device:
    """Opens a link and makes sure that a ribbon answers. Raises UsageError, LinkError and DeviceError."""
    device = Device(open_link(url, baud=baud), observer)
    try:
        device.handshake()
    except BaseException:
        device.close()
        raise
    return device


def _ack_name(code: int) -> str:
    try:
        return wire.AckCode(code).name.lower()
    except ValueError:
        return f"code {code}"
