"""The suite's own end of the link: keeps every frame with its time, and finds what answers what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.wire import Ack, AckCode, Command, CommandCode, Packet, PacketId, WireError, decode, encode

from ribbonhil.conformance.check import BrokenRuleError
from ribbonhil.conformance.link import Link

# A frame is at most the largest packet, its CRC, COBS overhead and delimiter; what is longer never ends.
LONGEST_CODED_BYTES = 4096
ACK_LIMIT_S = 0.25
PATIENCE_S = 1.0


@dataclass(frozen=True)
class Frame:
    """What stood between two delimiters.

    Attributes:
        t_host_s: when its end had arrived, on the link's clock.
        coded: the bytes as they came, without the delimiter.
        content: type byte and fields; empty if COBS or CRC are wrong.
        packet: the packet, or None if it is not known or too short.
        surplus: bytes after the last known field.
        problem: why there is no packet, else empty.
    """

    t_host_s: float
    coded: bytes
    content: bytes
    packet: Packet | None
    surplus: int
    problem: str

    @property
    def is_known(self) -> bool:
        """Whether it is a packet of a type that this suite knows, whole or not."""
        return bool(self.content) and self.content[0] in set(PacketId)


@dataclass(frozen=True)
class Reply:
    """An ACK, the frame it came in, that frame's place in the log, and how long it took."""

    ack: Ack
    frame: Frame
    place: int
    round_trip_s: float


def command_packet(code: int, argument: int = 0, data: bytes = b"", tag: int = 0) -> bytes:
    """Type byte and fields of a COMMAND; `code` may be one that no enumeration knows."""
    return encode(Command(tag=tag, command=code, argument=argument, data=data))


def command_name(code: int, argument: int = 0, data: bytes = b"") -> str:
    """What a person calls a command: "set_rate 100"."""
    name = CommandCode(code).name.lower() if code in set(CommandCode) else f"command {code}"
    return f"{name} {argument}{f' with {len(data)} bytes' if data else ''}"


def code_name(code: int) -> str:
    """What a person calls the code of an ACK."""
    return AckCode(code).name.lower() if code in set(AckCode) else f"code {code}"


class Client:
    """Sends packets and keeps what comes back in `log`, in order of arrival."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.log: list[Frame] = []
        self.bytes_received = 0
        self._pending = b""
        self._synchronised = False
        self._tag = 0

    def now_s(self) -> float:
        return self.link.now_s()

    def mark(self) -> int:
        """The place in the log from which on frames are new."""
        return len(self.log)

    def send_bytes(self, data: bytes) -> None:
        self.link.write(data)

    def send(self, packet: bytes) -> None:
        """Sends a packet (type byte and fields) as a frame."""
        self.link.write(encode_frame(packet))

    def receive(self, duration_s: float) -> list[Frame]:
        """All frames that arrive within `duration_s`."""
        since = self.mark()
        end_s = self.now_s() + duration_s
        while (left_s := end_s - self.now_s()) > 0.0:
            self._take(*self.link.read(left_s))
        return self.log[since:]

    def wait_for(self, wanted: Callable[[Frame], bool], since: int, timeout_s: float) -> Frame | None:
        """The first frame from `since` on that is wanted, waiting at most `timeout_s` for it."""
        end_s = self.now_s() + timeout_s
        while True:
            for frame in self.log[since:]:
                if wanted(frame):
                    return frame
            since = self.mark()
            left_s = end_s - self.now_s()
            if left_s <= 0.0:
                return None
            self._take(*self.link.read(left_s))

    def next_tag(self) -> int:
        """A tag that no command of the last 65,000 had."""
        self._tag = self._tag % 0xFFFE + 1
        return self._tag

    def try_command(
        self,
        code: int,
        argument: int = 0,
        data: bytes = b"",
        *,
        tag: int | None = None,
        timeout_s: float = PATIENCE_S,
    ) -> Reply | None:
        """Sends one COMMAND, once, and returns its ACK, None if there is none in time."""
        tag = self.next_tag() if tag is None else tag
        return self.try_packet(command_packet(code, argument, data, tag), tag, timeout_s)

    def try_packet(self, packet: bytes, tag: int, timeout_s: float = PATIENCE_S) -> Reply | None:
        """Sends a packet that stands for a COMMAND, whatever its bytes, and returns the ACK with that tag."""
        since = self.mark()
        sent_s = self.now_s()
        self.send(packet)
        frame = self.wait_for(lambda f: isinstance(f.packet, Ack) and f.packet.tag == tag, since, timeout_s)
        if frame is None:
            return None
        assert isinstance(frame.packet, Ack)
        place = next(i for i in range(since, len(self.log)) if self.log[i] is frame)
        return Reply(frame.packet, frame, place, frame.t_host_s - sent_s)

    def command(
        self,
        code: int,
        argument: int = 0,
        data: bytes = b"",
        *,
        tag: int | None = None,
        timeout_s: float = PATIENCE_S,
    ) -> Reply:
        """As try_command. Raises BrokenRuleError if no ACK comes."""
        tag = self.next_tag() if tag is None else tag
        reply = self.try_command(code, argument, data, tag=tag, timeout_s=timeout_s)
        if reply is None:
            raise BrokenRuleError(
                f"an ACK with tag {tag} for {command_name(code, argument, data)}",
                f"none within {timeout_s:g} s of sending the bytes shown",
                encode_frame(command_packet(code, argument, data, tag)),
            )
        return reply

    def _take(self, data: bytes, t_host_s: float) -> None:
        if not data:
            return
        self.bytes_received += len(data)
        *ended, self._pending = (self._pending + data).split(b"\0")
        for coded in ended:
            frame = inspect(coded, t_host_s)
            # The first bytes of a link that was opened in mid-stream are the end of a frame.
            if coded and (self._synchronised or not frame.problem):
                self.log.append(frame)
            self._synchronised = True
        if len(self._pending) > LONGEST_CODED_BYTES:
            self.log.append(Frame(t_host_s, self._pending, b"", None, 0, "longer than any frame"))
            self._pending = b""


def inspect(coded: bytes, t_host_s: float) -> Frame:
    """Takes a frame apart, and says what is wrong with it instead of raising."""
    deframer = Deframer()
    contents = deframer.feed(coded + b"\0")
    if not contents:
        problem = "wrong CRC" if deframer.crc_errors else "no COBS, empty, or too long"
        return Frame(t_host_s, coded, b"", None, 0, problem)
    content = contents[0]
    try:
        packet, surplus = decode(content)
    except WireError as error:
        return Frame(t_host_s, coded, content, None, 0, str(error))
    return Frame(t_host_s, coded, content, packet, surplus, "")
