"""A ribbon made of a script: speaks the protocol through the generated codec, in memory or over TCP."""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from ribbonhost import wire
from ribbonhost.clock import extend_us
from ribbonhost.framing import Deframer, encode_frame

NODES = 4
STRAIGHT = np.tile([1.0, 0.0, 0.0, 0.0], (NODES, 1))


def info_packet(**changes: object) -> wire.Info:
    values: dict[str, object] = {
        "wire_version": wire.WIRE_VERSION,
        "oldest_host_version": wire.OLDEST_HOST_VERSION,
        "schema_hash": wire.SCHEMA_HASH,
        "firmware_version": bytes((0, 1, 0)),
        "board": wire.Board.HOST,
        "unique_id": bytes(12),
        "pitch_m": 0.025,
        "rate_hz": 100,
        "rate_max_hz": 200,
        "mode": wire.Mode.ORIENT,
        "calibration_sequence": 0,
        "calibration_crc32": 0,
        "node_count": NODES,
        "slots": wire.SlotInfoArray(
            part=np.tile([wire.Part.LIS2DW12, wire.Part.MMC5983MA], NODES).astype(np.uint8),
            axes=np.tile([7, 3], NODES).astype(np.uint8),
            lsb=np.full(2 * NODES, 0.01),
        ),
    }
    return wire.Info(**(values | changes))  # type: ignore[arg-type]


def orient_packet(
    t_us: int, sequence: int, nodes: int = NODES, valid: list[bool] | None = None
) -> wire.Orient:
    return wire.Orient(
        t_us=t_us % (1 << 32),
        sequence=sequence % (1 << 16),
        nodes=wire.NodeArray(
            q_world_node=np.tile([1.0, 0.0, 0.0, 0.0], (nodes, 1)),
            valid=np.ones(nodes, bool) if valid is None else np.array(valid),
            quality=np.zeros(nodes, np.uint8),
        ),
    )


def status_packet() -> wire.Status:
    return wire.Status(
        t_us=0, uptime_s=1, scans=1, overruns=0, frames_dropped=0, rx_crc_errors=0, rx_malformed=0,
        rx_unknown=0, scan_us=500, rate_hz=100, mode=wire.Mode(0), reset_cause=wire.ResetCause.POWER_ON,
        clock_source=wire.ClockSource.HOST, temperature_c=25.0, fault_pc=0, fault_lr=0, fault_cfsr=0,
        slots=wire.SlotStatusArray(
            reason=np.zeros(2 * NODES, np.uint8), errors=np.zeros(2 * NODES, np.uint16)
        ),
        health=wire.SlotHealthArray(
            misfit=np.zeros(2 * NODES, np.uint8), length_permille=np.zeros(2 * NODES, np.int32)
        ),
    )  # fmt: skip


def frame_of(packet: wire.Packet) -> bytes:
    return encode_frame(wire.encode(packet))


@dataclass
class FakeRibbon:
    """A pyserial port with a ribbon behind it, in real time.

    clock_offset_us, drift_ppm: of its clock against the host's. refused: commands it answers with a code.
    deaf: answers nothing. paused: scans on, but sends no ORIENT. answer_info: what get_info sends. spoil:
    what becomes of each frame on the way.
    """

    serial: str = "00" * 12
    info_changes: dict[str, object] = field(default_factory=dict)
    clock_offset_us: int = 0
    drift_ppm: float = 0.0
    refused: dict[int, int] = field(default_factory=dict)
    deaf: bool = False
    paused: bool = False
    pongs: bool = True
    spoil: Callable[[bytes], bytes] = lambda frame: frame
    valid: list[bool] | None = None
    scan_us: int = 500

    def __post_init__(self) -> None:
        self.rate_hz = 100
        self.mode = 0
        self.sequence = 0
        self.commands: list[tuple[int, int]] = []
        self.scan_ends_us: list[int] = []
        self.vanished = False
        self.closed = False
        self._out = bytearray()
        self._changed = threading.Condition()
        self._deframer = Deframer()
        self._start_us = self.now_us()

    def now_us(self) -> int:
        return self.clock_offset_us + int(time.monotonic() * (1e6 + self.drift_ppm))

    def reset(self) -> None:
        """What a brown-out does: the clock, the sequence and the settings start anew, INFO is announced."""
        with self._changed:
            self.clock_offset_us -= self.now_us()
            self.rate_hz, self.mode, self.sequence, self._start_us = 50, wire.Mode.ORIENT, 0, 0
            self.send(frame_of(self._info()))

    def send(self, data: bytes) -> None:
        with self._changed:
            self._out += data
            self._changed.notify_all()

    def vanish(self) -> None:
        with self._changed:
            self.vanished = True
            self._changed.notify_all()

    @property
    def in_waiting(self) -> int:
        return len(self._out)

    def read(self, size: int = 1) -> bytes:
        deadline_s = time.monotonic() + 0.1
        with self._changed:
            while True:
                if self.vanished:
                    raise OSError("device reports readiness to read but returned no data")
                self._scan()
                if self._out or time.monotonic() >= deadline_s:
                    data = bytes(self._out[:size])
                    del self._out[:size]
                    return data
                self._changed.wait(
                    min(0.02, max(0.0005, (self._start_us + self.scan_us - self.now_us()) * 1e-6))
                )

    def write(self, data: bytes) -> int:
        if self.vanished:
            raise OSError("write failed: [Errno 5] Input/output error")
        t_receive_us = self.now_us()
        for packet in self._deframer.feed(data):
            if not self.deaf:
                self._answer(wire.decode(packet)[0], t_receive_us)
        return len(data)

    def close(self) -> None:
        self.closed = True

    def _info(self) -> wire.Info:
        changes: dict[str, object] = {"unique_id": bytes.fromhex(self.serial), "rate_hz": self.rate_hz}
        return info_packet(**(changes | self.info_changes))

    def _answer(self, message: wire.Packet, t_receive_us: int) -> None:
        if isinstance(message, wire.ClockPing):
            if self.pongs:
                times_us = t_receive_us % (1 << 32), self.now_us() % (1 << 32)
                self.send(self.spoil(frame_of(wire.ClockPong(message.tag, message.t_host_us, *times_us))))
            return
        assert isinstance(message, wire.Command)
        self.commands.append((int(message.command), message.argument))
        code = self.refused.get(int(message.command), wire.AckCode.OK)
        value = 0
        if code == wire.AckCode.OK:
            with self._changed:
                value = self._obey(message)
        self.send(self.spoil(frame_of(wire.Ack(message.tag, int(message.command), code, value, b""))))
        if message.command == wire.CommandCode.GET_INFO and code == wire.AckCode.OK:
            self.send(self.spoil(frame_of(self._info())))
        if message.command == wire.CommandCode.GET_STATUS and code == wire.AckCode.OK:
            self.send(self.spoil(frame_of(status_packet())))

    def _obey(self, command: wire.Command) -> int:
        match command.command:
            case wire.CommandCode.SET_RATE:
                self.rate_hz, self._start_us = command.argument, self.now_us()
                return self.rate_hz
            case wire.CommandCode.SET_MODE:
                self._scan()
                self.mode = command.argument
                return self.mode
            case wire.CommandCode.SET_PHASE:
                period_us = 1_000_000 // self.rate_hz
                wanted_us = extend_us(command.argument, self.now_us())
                past_us = (self._start_us - wanted_us) % period_us
                moved_us = -past_us if past_us < period_us / 2 else period_us - past_us
                self._start_us += moved_us
                return moved_us % (1 << 32)
        return 0

    def _scan(self) -> None:
        """Does the scans that have ended by now."""
        period_us = 1_000_000 // self.rate_hz
        while self._start_us + self.scan_us <= self.now_us():
            end_us = self._start_us + self.scan_us
            self._start_us += period_us
            self.sequence += 1
            if self.mode and not self.paused:
                self.scan_ends_us.append(end_us)
                self._out += self.spoil(frame_of(orient_packet(end_us, self.sequence, valid=self.valid)))


@contextmanager
def served(ribbon: FakeRibbon) -> Iterator[str]:
    """The URL of a TCP port of this machine behind which the ribbon is; the connection breaks when it
    vanishes."""
    server = socket.create_server(("127.0.0.1", 0))
    stopping = threading.Event()

    def send(connection: socket.socket, left: threading.Event) -> None:
        while not stopping.is_set() and not left.is_set():
            try:
                if data := ribbon.read(4096):
                    connection.sendall(data)
            except OSError:
                with contextlib.suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
                return

    def serve() -> None:
        server.settimeout(0.1)
        while not stopping.is_set():
            try:
                connection, _ = server.accept()
            except TimeoutError:
                continue
            with connection:
                left = threading.Event()
                sender = threading.Thread(target=send, args=(connection, left), daemon=True)
                sender.start()
                connection.settimeout(0.1)
                while not stopping.is_set():
                    try:
                        data = connection.recv(4096)
                    except TimeoutError:
                        continue
                    except OSError:
                        break
                    if not data or ribbon.vanished:
                        break
                    with contextlib.suppress(OSError):
                        ribbon.write(data)
                left.set()
                sender.join()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield f"socket://127.0.0.1:{server.getsockname()[1]}"
    finally:
        stopping.set()
        thread.join()
        server.close()
