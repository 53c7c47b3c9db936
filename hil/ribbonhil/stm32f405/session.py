"""A conversation with a ribbon in virtual time: frames in and out, commands and their answers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

from ribbonhost.errors import RibbonError
from ribbonhost.framing import Deframer, crc32, encode_frame
from ribbonhost.wire import (
    Ack,
    AckCode,
    Calibration,
    Command,
    CommandCode,
    Info,
    Orient,
    Packet,
    Status,
    decode,
    encode,
)

ANSWER_S = 1.5  # an erase of flash may take a second
SLICE_S = 0.002
SETTLE_S = 0.5  # after storing a calibration, which keeps scans from being made on time
CHUNK_BYTES = 192  # of a calibration record in one command


class SilentImageError(RibbonError):
    """The image does not do what every ribbon does."""


class VirtualRibbon(Protocol):
    """A ribbon whose time passes only when it is told to."""

    @property
    def now_s(self) -> float:
        """True time that it got to."""

    def run_until(self, t_s: float) -> None:
        """Lets time pass."""

    def read(self) -> bytes:
        """Bytes that have left the device."""

    def write(self, data: bytes) -> int:
        """Bytes toward the device."""


@dataclass
class Session:
    """What was said so far: the ORIENT packets as sent, answers by tag, the last INFO and STATUS."""

    ribbon: VirtualRibbon
    orients: list[bytes] = field(default_factory=list)
    acks: dict[int, Ack] = field(default_factory=dict)
    info: Info | None = None
    status: Status | None = None
    _deframer: Deframer = field(default_factory=Deframer)
    _tag: int = 0

    @property
    def crc_errors(self) -> int:
        """Frames that came with a wrong CRC or were no frames at all."""
        return self._deframer.crc_errors + self._deframer.malformed

    def run_for(self, duration_s: float) -> None:
        """Lets time pass and takes what comes."""
        self.ribbon.run_until(self.ribbon.now_s + duration_s)
        self.take(self.ribbon.read())

    def take(self, data: bytes) -> None:
        """Sorts what came."""
        for packet in self._deframer.feed(data):
            decoded = decode(packet)[0]
            if isinstance(decoded, Orient):
                self.orients.append(packet)
            elif isinstance(decoded, Info):
                self.info = decoded
            elif isinstance(decoded, Status):
                self.status = decoded
            elif isinstance(decoded, Ack):
                self.acks[decoded.tag] = decoded

    def wait_for_info(self, seconds: float = 2.0) -> Info:
        """The packet that every ribbon sends when it has started. Raises SilentImageError without one."""
        end_s = self.ribbon.now_s + seconds
        while self.info is None and self.ribbon.now_s < end_s:
            self.run_for(SLICE_S)
        if self.info is None:
            raise SilentImageError(
                f"No INFO came within {seconds:g} s of virtual time: the image is no ribbon firmware, "
                "or was built for another board (--board)"
            )
        return self.info

    def command(self, code: CommandCode, argument: int = 0, data: bytes = b"") -> Ack:
        """Sends a command and waits for its answer. Raises SilentImageError for none, or a refusal."""
        self._tag += 1
        packet: Packet = Command(self._tag, code, argument, data)
        self.ribbon.write(encode_frame(encode(packet)))
        end_s = self.ribbon.now_s + ANSWER_S
        while self._tag not in self.acks and self.ribbon.now_s < end_s:
            self.run_for(SLICE_S)
        ack = self.acks.get(self._tag)
        if ack is None:
            raise SilentImageError(f"{code.name} was not answered within {ANSWER_S:g} s of virtual time")
        if ack.code != AckCode.OK:
            raise SilentImageError(f"{code.name} was refused: {AckCode(ack.code).name}")
        return ack

    def read_calibration(self) -> Calibration:
        """The calibration in use."""
        ack = self.command(CommandCode.CALIBRATION_READ, 0)
        record, size = bytes(ack.data), ack.value
        while len(record) < size:
            record += bytes(self.command(CommandCode.CALIBRATION_READ, len(record)).data)
        return Calibration.unpack(record)

    def write_calibration(self, calibration: Calibration) -> None:
        """Writes and commits a calibration, as a host does."""
        record = calibration.pack()
        for offset in range(0, len(record), CHUNK_BYTES):
            self.command(CommandCode.CALIBRATION_WRITE, offset, record[offset : offset + CHUNK_BYTES])
        self.command(CommandCode.CALIBRATION_COMMIT, crc32(record))

    def set_axes(self, axes: int | None) -> int:
        """Makes it a ribbon whose magnetometers have 2 or 3 axes, by its calibration; None leaves it alone.

        Returns how many they have."""
        calibration = self.read_calibration()
        if axes is not None and axes != calibration.mag_axes:
            self.write_calibration(replace(calibration, mag_axes=axes, created_s=1))
            self.run_for(SETTLE_S)
        return axes or calibration.mag_axes

    def current_status(self) -> Status:
        """A STATUS of this moment."""
        self.status = None
        self.command(CommandCode.GET_STATUS)
        return self._next_status()

    def _next_status(self) -> Status:
        end_s = self.ribbon.now_s + ANSWER_S
        while self.status is None and self.ribbon.now_s < end_s:
            self.run_for(SLICE_S)
        if self.status is None:
            raise SilentImageError("GET_STATUS was acknowledged, but no STATUS came")
        return self.status
