"""What a device was asked, and which of its answers belong to it."""

import random
import threading
from dataclasses import dataclass, field

from ribbonhost import wire

PINGS_KEPT = 64


@dataclass
class Question:
    """A command that waits for its ACK. `done` is set when that came, or none can come any more."""

    command: int
    done: threading.Event = field(default_factory=threading.Event)
    ack: wire.Ack | None = None


class Questions:
    """Commands, clock pings and requests for INFO under way. Any thread may ask; one takes answers."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # A program before this one may have left answers on the link: another first tag keeps them apart.
        self._tag = random.randrange(1 << 16)
        self._commands: dict[int, Question] = {}
        self._pings: dict[int, int] = {}
        self._infos_due = 0

    def next_tag(self) -> int:
        """A tag that no question under way has."""
        with self._lock:
            self._tag = (self._tag + 1) % (1 << 16)
            return self._tag

    def ask(self, tag: int, command: int) -> Question:
        """A command is about to be sent, perhaps several times; it waits until it is withdrawn."""
        return self._commands.setdefault(tag, Question(command))

    def withdraw(self, tag: int) -> None:
        """Nobody waits for the answer to a command any more."""
        del self._commands[tag]

    def sent(self, packet: wire.Packet) -> None:
        """A packet is about to be sent."""
        if isinstance(packet, wire.ClockPing):
            with self._lock:
                while len(self._pings) >= PINGS_KEPT:
                    del self._pings[next(iter(self._pings))]
                self._pings[packet.tag] = packet.t_host_us
        elif isinstance(packet, wire.Command) and packet.command == wire.CommandCode.GET_INFO:
            self._infos_due += 1

    def question_of(self, ack: wire.Ack) -> Question | None:
        """The command that an ACK answers; None if there is none."""
        question = self._commands.get(ack.tag)
        return question if question and question.command == ack.command else None

    def expects_pong(self, pong: wire.ClockPong) -> bool:
        """Whether it answers a ping, which then is answered."""
        with self._lock:
            if self._pings.get(pong.tag) != pong.t_host_us:
                return False
            del self._pings[pong.tag]
            return True

    def expects_info(self) -> bool:
        """Whether INFO was asked for and has not come as often: then it counts as come."""
        if self._infos_due == 0:
            return False
        self._infos_due -= 1
        return True

    def give_up(self) -> None:
        """No answer can come any more."""
        for question in tuple(self._commands.values()):
            question.done.set()

    def restart(self) -> None:
        """There is a new link: answers to pings and requests that went over the old one will not come."""
        with self._lock:
            self._pings.clear()
        self._infos_due = 0
