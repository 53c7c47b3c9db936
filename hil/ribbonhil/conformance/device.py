"""The device under test: what the checks ask of it, and how it is left as it was found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TypeVar

from ribbonhost.errors import LinkLostError, NoAnswerError, WireVersionError
from ribbonhost.framing import crc32
from ribbonhost.wire import WIRE_VERSION, AckCode, CommandCode, Info, Mode, Packet, Part, Status

from ribbonhil.conformance.check import BrokenRuleError
from ribbonhil.conformance.client import PATIENCE_S, Client, Frame, Reply, code_name, command_name
from ribbonhil.conformance.link import Link

P = TypeVar("P", bound=Packet)

START_S = 3.0
START_RETRY_S = 0.5
BRING_UP_S = 1.0
CHUNK_BYTES = 192
# A commit answers after the flash was erased and written.
COMMIT_PATIENCE_S = 5.0
# What was queued before a command was answered may still come after its ACK.
SETTLE_S = 0.2
QUIET = Mode(0)
LEAVE_TRIES = 3


@dataclass(frozen=True)
class Recording:
    """What a device sent while left alone in one mode, from one STATUS that was asked for to another."""

    rate_hz: int
    mode: Mode
    before: Status
    after: Status
    frames: tuple[Frame, ...]

    def of(self, kind: type[P]) -> list[tuple[Frame, P]]:
        """Packets of one kind with the frames they came in."""
        return [(f, f.packet) for f in self.frames if isinstance(f.packet, kind)]


class Device(Client):
    """A client that knows what a ribbon does. Methods that ask it raise BrokenRuleError if no answer comes.

    Attributes:
        info: what INFO said at first.
        original_record: the calibration record in use at first, once a check wants to write one.
        gone: the device has left its firmware, as it was told to.
    """

    info: Info

    def __init__(self, link: Link) -> None:
        super().__init__(link)
        self._recordings: dict[tuple[int, Mode], tuple[float, Recording]] = {}
        self.original_record: bytes | None = None
        self.gone = False

    def start(self) -> None:
        """Finds out who answers.

        Raises NoAnswerError if nobody does, WireVersionError if the device needs a later host.
        """
        self.send_bytes(b"\0")
        end_s = self.now_s() + START_S
        while self.now_s() < end_s:
            reply = self.try_command(CommandCode.GET_INFO, timeout_s=START_RETRY_S)
            if reply:
                self.info = self._first_info(reply)
                break
        else:
            raise NoAnswerError(self._why_no_answer())
        if self.info.oldest_host_version > WIRE_VERSION:
            raise WireVersionError(
                f"The device wants a host of wire version {self.info.oldest_host_version} or later, this one "
                f"speaks {WIRE_VERSION}: take a newer ribbonhil."
            )

    def _first_info(self, reply: Reply) -> Info:
        """What INFO says at first; that of the start if there is no other, which a check finds out."""
        info = self._info_since(reply.place) or self._info_since(0)
        if info is None:
            raise NoAnswerError("The device acknowledges get_info, but sends no INFO packet.")
        if Part.NONE in info.slots.part:
            # A device that has just started may still be looking for its parts.
            self.receive(BRING_UP_S)
            later = self.try_command(CommandCode.GET_INFO)
            info = (later and self._info_since(later.place)) or info
        return info

    def _info_since(self, place: int) -> Info | None:
        frame = self.wait_for(lambda f: isinstance(f.packet, Info), place, PATIENCE_S)
        return frame.packet if frame and isinstance(frame.packet, Info) else None

    def _why_no_answer(self) -> str:
        good = sum(not frame.problem for frame in self.log)
        if good:
            return f"The device sends packets ({good} in {START_S:g} s), but acknowledges no command."
        if self.bytes_received:
            return (
                f"{self.bytes_received} bytes came in {START_S:g} s, but no packet: "
                "is this the right port, and --baud the right speed?"
            )
        return f"Nothing answered in {START_S:g} s: is this the right port, and the device on?"

    def get_info(self) -> tuple[Frame, Info]:
        """A fresh INFO packet."""
        return self._ask_for(CommandCode.GET_INFO, Info)

    def get_status(self) -> tuple[Frame, Status]:
        """A fresh STATUS packet."""
        return self._ask_for(CommandCode.GET_STATUS, Status)

    def _ask_for(self, command: CommandCode, kind: type[P]) -> tuple[Frame, P]:
        reply = self.accepted(command)
        frame = self.wait_for(lambda f: isinstance(f.packet, kind), reply.place, PATIENCE_S)
        if frame is None:
            raise BrokenRuleError(
                f"a {kind.__name__.upper()} packet after the ACK of {command.name.lower()}", "none"
            )
        assert isinstance(frame.packet, kind)
        return frame, frame.packet

    def set(self, rate_hz: int, mode: Mode) -> None:
        """Sets rate and mode. Raises BrokenRuleError if one is refused."""
        for command, argument in ((CommandCode.SET_RATE, rate_hz), (CommandCode.SET_MODE, mode)):
            self.accepted(command, argument)

    def quiet(self) -> None:
        """Tries to stop the packets that follow scans; a device that cannot is found by other checks."""
        self.try_command(CommandCode.SET_MODE, QUIET)

    def accepted(
        self, command: CommandCode, argument: int = 0, data: bytes = b"", timeout_s: float = PATIENCE_S
    ) -> Reply:
        """Sends a command. Raises BrokenRuleError unless it is acknowledged as done."""
        return self.answered(AckCode.OK, command, argument, data, timeout_s)

    def answered(
        self,
        code: AckCode,
        command: int,
        argument: int = 0,
        data: bytes = b"",
        timeout_s: float = PATIENCE_S,
    ) -> Reply:
        """Sends a command. Raises BrokenRuleError unless its ACK has this code."""
        reply = self.command(command, argument, data, timeout_s=timeout_s)
        if reply.ack.code != code:
            raise BrokenRuleError(
                f"{code_name(code)} for {command_name(command, argument, data)}",
                code_name(reply.ack.code),
                reply.frame.coded,
            )
        return reply

    def record(self, rate_hz: int, mode: Mode, duration_s: float) -> Recording:
        """What the device sends in `duration_s` or longer; one recording serves all checks that want it."""
        known = self._recordings.get((rate_hz, mode))
        if known and known[0] >= duration_s:
            return known[1]
        self.set(rate_hz, mode)
        self.receive(SETTLE_S + 1.0 / rate_hz)
        since = self.mark()
        _, before = self.get_status()
        self.receive(duration_s)
        self.quiet()
        # Replies overtake the stream: what was queued comes before the counters are taken again.
        self.receive(SETTLE_S)
        _, after = self.get_status()
        recording = Recording(rate_hz, mode, before, after, tuple(self.log[since:]))
        self._recordings[rate_hz, mode] = (duration_s, recording)
        return recording

    def read_calibration(self) -> bytes:
        """The calibration record in use. Raises BrokenRuleError if it cannot be read whole."""
        record = b""
        while True:
            reply = self.accepted(CommandCode.CALIBRATION_READ, len(record))
            if not reply.ack.data:
                return record
            record += reply.ack.data
            if len(record) > reply.ack.value:
                raise BrokenRuleError(
                    f"at most {reply.ack.value} bytes, the size told", len(record), reply.frame.coded
                )

    def stage_calibration(self, record: bytes) -> None:
        """Writes a record to the staging area. Raises BrokenRuleError if a chunk is refused."""
        for offset in range(0, len(record), CHUNK_BYTES):
            self.accepted(CommandCode.CALIBRATION_WRITE, offset, record[offset : offset + CHUNK_BYTES])

    def commit_calibration(self, record: bytes, code: AckCode = AckCode.OK) -> Reply:
        """Stages and commits a record. Raises BrokenRuleError unless the commit ends with `code`."""
        self.stage_calibration(record)
        return self.answered(code, CommandCode.CALIBRATION_COMMIT, crc32(record), timeout_s=COMMIT_PATIENCE_S)

    @contextmanager
    def calibration_kept(self) -> Iterator[None]:
        """Puts the record in use back afterwards; `leave` tells if that fails.

        Raises BrokenRuleError, so that nothing is written, if the record cannot be read as INFO says it is.
        """
        if self.original_record is None:
            record = self.read_calibration()
            frame, info = self.get_info()
            if crc32(record) != info.calibration_crc32:
                raise BrokenRuleError(
                    f"a record with INFO's CRC-32 {info.calibration_crc32:08x} before another is written",
                    f"{len(record)} bytes with {crc32(record):08x}",
                    frame.coded,
                )
            self.original_record = record
        try:
            yield
        finally:
            with suppress(BrokenRuleError):
                self._restore_calibration()

    def _restore_calibration(self) -> None:
        if self.original_record is not None and self.read_calibration() != self.original_record:
            self.commit_calibration(self.original_record)

    def leave(self) -> str:
        """Puts calibration, rate and mode back as they were; says what could not be, nothing if all was."""
        if self.gone:
            return ""
        problems = []
        for what, put_back in (
            ("calibration record", self._restore_calibration),
            ("rate and mode", lambda: self.set(self.info.rate_hz, Mode(self.info.mode))),
        ):
            problem = ""
            for _ in range(LEAVE_TRIES):
                try:
                    put_back()
                except (BrokenRuleError, LinkLostError) as error:
                    problem = str(error)
                else:
                    problem = ""
                    break
            if problem:
                problems.append(f"the {what} could not be put back: {problem}")
        return "; ".join(problems)
