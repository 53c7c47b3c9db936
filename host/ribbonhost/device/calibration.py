"""The calibration record of a device: read, and replaced as a whole or not at all."""

from dataclasses import dataclass
from functools import cached_property

from ribbonhost import wire
from ribbonhost.device.device import Device
from ribbonhost.errors import CommandRefusedError, CommandTimeoutError, DeviceError
from ribbonhost.framing import crc32

CHUNK_BYTES = 192
"""What one CALIBRATION_READ or CALIBRATION_WRITE carries at most."""

RECORD_BYTES_MAX = 4096
"""More than any record of this schema: what claims to be longer is not read."""

COMMIT_S = 5.0
"""Erasing flash takes seconds where a board has large sectors."""


@dataclass(frozen=True)
class StoredCalibration:
    """What a device has in use.

    Attributes:
        record: the bytes of the record.
        sequence: counts commits; 0: never calibrated.
    """

    record: bytes
    sequence: int

    @property
    def crc32(self) -> int:
        """CRC-32 of the record."""
        return crc32(self.record)

    @cached_property
    def values(self) -> wire.Calibration:
        """What the record says. Raises WireError if it is none."""
        return wire.Calibration.unpack(self.record)


def read_calibration(device: Device) -> StoredCalibration:
    """Reads the record in use. Raises LinkError, and DeviceError if what comes cannot be the record."""
    record = b""
    size = 1
    while len(record) < size:
        ack = device.command(wire.CommandCode.CALIBRATION_READ, len(record))
        size = ack.value
        record += ack.data
        if not 0 < size <= RECORD_BYTES_MAX or not ack.data or len(record) > size:
            raise DeviceError(
                f"{device.name} says its calibration has {size} bytes and sent {len(ack.data)} "
                f"that make {len(record)}: that cannot be"
            )
    info = device.handshake()
    stored = StoredCalibration(record, info.calibration_sequence)
    if stored.crc32 != info.calibration_crc32:
        raise DeviceError(
            f"the calibration read from {device.name} has CRC {stored.crc32:08x} where the device says "
            f"{info.calibration_crc32:08x}: it was replaced meanwhile, or spoiled on the way; try again"
        )
    try:
        slots = len(stored.values.slots)
    except wire.WireError as error:
        raise DeviceError(
            f"the calibration of {device.name} is not one that this host knows: {error}"
        ) from error
    if slots != len(info.slots):
        raise DeviceError(
            f"the calibration of {device.name} has {slots} slots where the device has {len(info.slots)}"
        )
    return stored


def write_calibration(device: Device, calibration: wire.Calibration) -> StoredCalibration:
    """Replaces the record, reads it back, and returns it.

    The device uses the old one until all bytes of the new one are there, checked and stored; whatever fails
    before leaves the old one in use. Raises LinkError, CommandRefusedError if the device does not accept it,
    DeviceError if something else is in use afterwards, WireError for values that fit in no record.
    """
    record = calibration.pack()
    kept = "the calibration it had is still in use"
    try:
        for start in range(0, len(record), CHUNK_BYTES):
            chunk = record[start : start + CHUNK_BYTES]
            written = device.command(wire.CommandCode.CALIBRATION_WRITE, start, chunk).value
            if written != len(chunk):
                raise DeviceError(f"{device.name} took {written} of {len(chunk)} bytes: {kept}")
    except CommandRefusedError as error:
        raise CommandRefusedError(f"{error}; {kept}", error.code) from error
    except CommandTimeoutError as error:
        raise CommandTimeoutError(f"{error}; {kept}") from error
    try:
        device.command(wire.CommandCode.CALIBRATION_COMMIT, crc32(record), timeout_s=COMMIT_S)
    except CommandRefusedError as error:
        raise CommandRefusedError(f"{error}; {kept}", error.code) from error
    stored = read_calibration(device)
    if stored.record != record:
        raise DeviceError(f"{device.name} accepted a calibration but has another one in use: try again")
    return stored
