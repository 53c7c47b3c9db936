"""A ribbon in Python and virtual time: all of the protocol, written apart from the firmware."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable

import numpy as np
from conformance.ribbon_state import CLOCK_MODULUS, SCAN_US, RibbonState
from ribbonhost import wire
from ribbonhost.framing import Deframer, crc32, encode_frame
from ribbonhost.wire import AckCode, CommandCode, Mode

LATENCY_US = 1_000
STATUS_PERIOD_US = 1_000_000
NEVER_US = 2**62
Answer = tuple[AckCode, int, bytes]


def smallest_turn_us(difference_us: int, period_us: int) -> int:
    """The move of at most half a period that has the same effect as `difference_us`."""
    return (difference_us + period_us // 2) % period_us - period_us // 2


class Responder(RibbonState):
    """The device's end of a link, and the link: write() hands it bytes, read() lets its time pass.

    Subclasses break one rule each.
    """

    has_dfu = True
    latency_us = LATENCY_US

    def __init__(self) -> None:
        super().__init__()
        self.opened_s = 0.0
        self.powered = False
        self.outbox: deque[tuple[int, bytes]] = deque()
        self.inbox = b""
        self.scan_start_us = self.power_on_us + 50_000
        self.status_due_us = self.power_on_us + STATUS_PERIOD_US
        self.staged = bytearray(len(self.record))
        self.commands: dict[int, Callable[[int, bytes], Answer]] = {
            CommandCode.GET_INFO: self.get_info,
            CommandCode.GET_STATUS: self.get_status,
            CommandCode.SET_RATE: self.set_rate,
            CommandCode.SET_MODE: self.set_mode,
            CommandCode.SET_PHASE: self.set_phase,
            CommandCode.IDENTIFY: self.identify,
            CommandCode.CALIBRATION_READ: self.calibration_read,
            CommandCode.CALIBRATION_WRITE: self.calibration_write,
            CommandCode.CALIBRATION_COMMIT: self.calibration_commit,
            CommandCode.ENTER_DFU: self.enter_dfu,
        }
        self.after_ack: list[Callable[[], None]] = []
        self.packed_attitude: np.ndarray | None = None
        self.packed: dict[type, bytes] = {}

    # ------------------------------------------------------------ the link

    def now_s(self) -> float:
        return self.t_us / self.clock_ratio * 1e-6

    def write(self, data: bytes) -> None:
        if self.powered:
            self.receive(data)

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        deadline_us = self.t_us + max(1, math.ceil(timeout_s * self.clock_ratio * 1e6))
        while True:
            event_us = self.next_event_us()
            arrival_us = self.outbox[0][0] if self.outbox else NEVER_US
            self.t_us = max(self.t_us, min(event_us, arrival_us, deadline_us))
            if event_us <= self.t_us:
                self.run_event()
            elif arrival_us <= self.t_us:
                data = b""
                while self.outbox and self.outbox[0][0] <= self.t_us:
                    data += self.outbox.popleft()[1]
                return data, self.now_s()
            else:
                return b"", self.now_s()

    def close(self) -> None:
        pass

    # ------------------------------------------------------------ time

    def next_event_us(self) -> int:
        if not self.powered:
            return self.power_on_us
        return min(self.scan_start_us + SCAN_US, self.status_due_us)

    def run_event(self) -> None:
        if not self.powered:
            self.powered = True
            self.start()
        elif self.t_us >= self.scan_start_us + SCAN_US:
            self.scan()
        else:
            self.status_due_us += STATUS_PERIOD_US
            self.send(self.status())

    def start(self) -> None:
        self.send(self.info())

    def scan(self) -> None:
        self.scan_start_us += self.period_us()
        self.sequence = (self.sequence + 1) % 65_536
        self.scans += 1
        for slot in self.absent_slots:
            self.errors[slot] = min(self.errors[slot] + 1, 65_535)
        t_us = self.clock_us()
        for flag, build in (
            (Mode.ORIENT, self.orient),
            (Mode.ORIENT_COMPACT, self.compact),
            (Mode.RAW, self.raw),
        ):
            if flag in self.mode:
                self.send(build(t_us))

    # ------------------------------------------------------------ frames

    def send(self, packet: wire.Packet) -> None:
        self.send_content(self.content(packet))

    def content(self, packet: wire.Packet) -> bytes:
        """The bytes of a packet; those of nodes, slow to pack, once for each attitude."""
        if not isinstance(packet, wire.Orient | wire.OrientCompact):
            return wire.encode(packet)
        if packet.nodes.q_world_node is not self.packed_attitude:
            self.packed.clear()
            self.packed_attitude = packet.nodes.q_world_node
        kind = type(packet)
        if kind not in self.packed:
            self.packed[kind] = wire.encode(packet)
        packed = self.packed[kind]
        return struct.pack("<BIH", packed[0], packet.t_us, packet.sequence) + packed[7:]

    def send_content(self, content: bytes) -> None:
        self.transmit(encode_frame(content))

    def transmit(self, frame: bytes) -> None:
        self.outbox.append((self.t_us + self.latency_us, frame))

    def receive(self, data: bytes) -> None:
        *frames, self.inbox = (self.inbox + data).split(b"\0")
        for coded in frames:
            self.on_frame(coded)

    def on_frame(self, coded: bytes) -> None:
        if not coded:
            return
        deframer = Deframer()
        contents = deframer.feed(coded + b"\0")
        self.rx["rx_crc_errors"] += deframer.crc_errors
        self.rx["rx_malformed"] += deframer.malformed
        for content in contents:
            self.on_packet(content)

    def on_packet(self, content: bytes) -> None:
        if content[0] == wire.PacketId.COMMAND:
            self.on_command(content)
        elif content[0] == wire.PacketId.CLOCK_PING:
            self.on_ping(content)
        else:
            self.rx["rx_unknown"] += 1

    def on_ping(self, content: bytes) -> None:
        if len(content) < 11:
            self.rx["rx_malformed"] += 1
            return
        _, tag, t_host_us = struct.unpack_from("<BHQ", content)
        self.send(self.pong(tag, t_host_us))

    def pong(self, tag: int, t_host_us: int) -> wire.ClockPong:
        t_receive_us = self.clock_us()
        return wire.ClockPong(tag, t_host_us, t_receive_us, (t_receive_us + 20) % CLOCK_MODULUS)

    # ------------------------------------------------------------ commands

    def on_command(self, content: bytes) -> None:
        if len(content) < 4:
            self.rx["rx_malformed"] += 1
            return
        _, tag, command, argument, count = struct.unpack_from("<BHBIB", content.ljust(9, b"\0"))
        data = content[9 : 9 + count]
        if len(content) < 9 or len(data) < count or count > 192:
            answer: Answer = (AckCode.BAD_LENGTH, 0, b"")
        elif command in self.commands:
            answer = self.commands[command](argument, data)
        else:
            answer = (AckCode.UNKNOWN_COMMAND, 0, b"")
        self.acknowledge(tag, command, *answer)
        actions, self.after_ack = self.after_ack, []
        for action in actions:
            action()

    def acknowledge(self, tag: int, command: int, code: AckCode, value: int, data: bytes) -> None:
        self.send(wire.Ack(tag, command, code, value, data))

    def get_info(self, argument: int, data: bytes) -> Answer:
        self.after_ack.append(lambda: self.send(self.info()))
        return AckCode.OK, 0, b""

    def get_status(self, argument: int, data: bytes) -> Answer:
        self.after_ack.append(lambda: self.send(self.status()))
        return AckCode.OK, 0, b""

    def set_rate(self, argument: int, data: bytes) -> Answer:
        if not 1 <= argument <= self.rate_max_hz:
            return AckCode.BAD_ARGUMENT, 0, b""
        self.rate_hz = argument
        self.scan_start_us = self.t_us
        return AckCode.OK, self.rate_hz, b""

    def set_mode(self, argument: int, data: bytes) -> Answer:
        exclusive = Mode.ORIENT | Mode.ORIENT_COMPACT
        if argument > 7 or argument & exclusive == exclusive:
            return AckCode.BAD_ARGUMENT, 0, b""
        self.mode = Mode(argument)
        return AckCode.OK, argument, b""

    def set_phase(self, argument: int, data: bytes) -> Answer:
        period_us = self.period_us()
        next_us = (self.clock_start_us + self.scan_start_us) % CLOCK_MODULUS
        ahead_us = (argument - next_us + CLOCK_MODULUS // 2) % CLOCK_MODULUS - CLOCK_MODULUS // 2
        move_us = smallest_turn_us(ahead_us, period_us)
        self.scan_start_us += move_us
        while self.scan_start_us < self.t_us:
            self.scan_start_us += period_us
        return AckCode.OK, move_us % CLOCK_MODULUS, b""

    def identify(self, argument: int, data: bytes) -> Answer:
        return (AckCode.OK if argument <= wire.IDENTIFY_MAX_MS else AckCode.BAD_ARGUMENT), 0, b""

    def calibration_read(self, argument: int, data: bytes) -> Answer:
        return AckCode.OK, len(self.record), self.record[argument : argument + 192]

    def calibration_write(self, argument: int, data: bytes) -> Answer:
        if not data or argument + len(data) > len(self.staged):
            return AckCode.BAD_ARGUMENT, 0, b""
        self.staged[argument : argument + len(data)] = data
        return AckCode.OK, len(data), b""

    def calibration_commit(self, argument: int, data: bytes) -> Answer:
        staged = bytes(self.staged)
        if crc32(staged) != argument:
            return AckCode.BAD_CRC, 0, b""
        if not self.is_sound(staged):
            return AckCode.BAD_ARGUMENT, 0, b""
        if staged != self.record:
            self.record = staged
            self.calibration_sequence += 1
        return AckCode.OK, self.calibration_sequence, b""

    def enter_dfu(self, argument: int, data: bytes) -> Answer:
        if argument != wire.ENTER_DFU_KEY:
            return AckCode.BAD_ARGUMENT, 0, b""
        if not self.has_dfu:
            return AckCode.UNSUPPORTED, 0, b""
        self.after_ack.append(self.leave_firmware)
        return AckCode.OK, 0, b""

    def leave_firmware(self) -> None:
        self.powered = False
        self.power_on_us = NEVER_US
