"""Calibration: reading the record in use, staging another, and committing it only if it is sound."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import partial

from ribbonhost.framing import crc32, encode_frame
from ribbonhost.wire import (
    CALIBRATION_FIELD_DOWN_UT_RANGE,
    CALIBRATION_FIELD_HORIZONTAL_UT_RANGE,
    CALIBRATION_LAYOUT,
    CALIBRATION_MAG_AXES_RANGE,
    CALIBRATION_PITCH_M_RANGE,
    AckCode,
    Axes,
    Calibration,
    CommandCode,
    Part,
    WireError,
)

from ribbonhil.conformance.check import BrokenRuleError, Group, NotObservedError, Permission, expect
from ribbonhil.conformance.client import code_name, command_packet
from ribbonhil.conformance.device import CHUNK_BYTES, COMMIT_PATIENCE_S, Device

GROUP = Group("calibration")

WRITES = Permission.CALIBRATION_WRITE
# Where fields of the record stand, for records that the codec would not write.
LAYOUT_AT, MAG_AXES_AT, SLOT_COUNT_AT, CREATED_AT, PITCH_AT, HORIZONTAL_AT, DOWN_AT, SLOTS_AT = (
    0,
    2,
    3,
    4,
    8,
    12,
    16,
    20,
)


def with_bytes(record: bytes, at: int, replacement: bytes) -> bytes:
    """The record with other bytes at a place."""
    return record[:at] + replacement + record[at + len(replacement) :]


def with_float(record: bytes, at: int, value: float) -> bytes:
    """The record with another number at a place."""
    return with_bytes(record, at, struct.pack("<f", value))


def other_record(record: bytes) -> bytes:
    """A sound record that differs only in when it was made."""
    created_s = int.from_bytes(record[CREATED_AT : CREATED_AT + 4], "little")
    return with_bytes(record, CREATED_AT, (created_s ^ 1).to_bytes(4, "little"))


def decoded(record: bytes) -> Calibration:
    """The record taken apart. Raises BrokenRuleError if it is none."""
    try:
        return Calibration.unpack(record)
    except WireError as error:
        raise BrokenRuleError("a calibration record", str(error), record) from error


def expect_in_use(device: Device, record: bytes, sequence: int) -> None:
    """Raises BrokenRuleError unless this record, with this sequence, is read back and told by INFO."""
    frame, info = device.get_info()
    expect(
        info.calibration_crc32 == crc32(record),
        f"INFO.calibration_crc32 {crc32(record):08x}",
        f"{info.calibration_crc32:08x}",
        frame,
    )
    expect(
        info.calibration_sequence == sequence,
        f"INFO.calibration_sequence {sequence}",
        info.calibration_sequence,
        frame,
    )
    seen = device.read_calibration()
    if seen != record:
        raise BrokenRuleError(
            f"the record with CRC-32 {crc32(record):08x} read back", f"{crc32(seen):08x}", seen
        )


def expect_refused(device: Device, change: Callable[[bytes], bytes]) -> None:
    """Raises BrokenRuleError unless a changed record is a bad_argument and the one in use stays."""
    original = device.read_calibration()
    _, info = device.get_info()
    device.commit_calibration(change(original), AckCode.BAD_ARGUMENT)
    expect_in_use(device, original, info.calibration_sequence)


@GROUP.check("Calibration")
def record_is_read_in_chunks(device: Device) -> None:
    """calibration_read tells the size at every offset, and gives the bytes from there, at most 192."""
    first = device.accepted(CommandCode.CALIBRATION_READ, 0)
    size = first.ack.value
    record = device.read_calibration()
    expect(len(record) == size, f"{size} bytes, as ACK.value says", len(record), first.frame)
    for offset in (1, size // 2, size - 1):
        reply = device.accepted(CommandCode.CALIBRATION_READ, offset)
        expect(reply.ack.value == size, f"ACK.value {size}", reply.ack.value, reply.frame)
        count = len(reply.ack.data)
        expect(
            0 < count <= CHUNK_BYTES and reply.ack.data == record[offset : offset + count],
            f"1 to {CHUNK_BYTES} bytes of the record from {offset}",
            f"{count} bytes: {reply.ack.data[:8].hex()} ...",
            reply.frame,
        )


@GROUP.check("Calibration")
def reading_beyond_the_end_gives_nothing(device: Device) -> None:
    """calibration_read at or beyond the end of the record is ok and gives no bytes."""
    size = device.accepted(CommandCode.CALIBRATION_READ, 0).ack.value
    for offset in (size, size + 1, 65_536, 2**32 - 1):
        reply = device.accepted(CommandCode.CALIBRATION_READ, offset)
        seen = (reply.ack.value, len(reply.ack.data))
        expect(
            seen == (size, 0),
            f"size {size} and no bytes at {offset}",
            f"{seen[0]} and {seen[1]}",
            reply.frame,
        )


@GROUP.check("INFO")
def record_has_the_crc_of_info(device: Device) -> None:
    """calibration_crc32 of INFO is the CRC-32 of the record in use."""
    record = device.read_calibration()
    frame, info = device.get_info()
    expect(
        crc32(record) == info.calibration_crc32,
        f"CRC-32 {info.calibration_crc32:08x}",
        f"{crc32(record):08x} over {len(record)} bytes",
        frame,
    )


@GROUP.check("Calibration")
def record_is_sound(device: Device) -> None:
    """The record in use has layout 1, the device's slots, and finite numbers within their ranges."""
    import numpy as np

    data = device.read_calibration()
    record = decoded(data)

    def within(name: str, value: float, limits: tuple[float, float]) -> None:
        # Half a single-precision step of slack: 0.001 is none of its numbers.
        if not limits[0] * (1 - 1e-6) <= value <= limits[1] * (1 + 1e-6) and not (
            limits[0] <= value <= limits[1]
        ):
            raise BrokenRuleError(f"{name} in {limits[0]} to {limits[1]}", f"{value}", data[:SLOTS_AT])

    if record.layout != CALIBRATION_LAYOUT:
        raise BrokenRuleError(f"layout {CALIBRATION_LAYOUT}", str(record.layout), data[:SLOTS_AT])
    if len(record.slots) != len(device.info.slots):
        raise BrokenRuleError(
            f"{len(device.info.slots)} slots, as INFO says", str(len(record.slots)), data[:SLOTS_AT]
        )
    within("mag_axes", record.mag_axes, CALIBRATION_MAG_AXES_RANGE)
    within("pitch_m", record.pitch_m, CALIBRATION_PITCH_M_RANGE)
    within("field_horizontal_ut", record.field_horizontal_ut, CALIBRATION_FIELD_HORIZONTAL_UT_RANGE)
    within("field_down_ut", record.field_down_ut, CALIBRATION_FIELD_DOWN_UT_RANGE)
    if not (np.isfinite(record.slots.offset).all() and np.isfinite(record.slots.matrix).all()):
        raise BrokenRuleError("finite numbers in every slot", "others", data)


@GROUP.check("Calibration")
def uncalibrated_record_is_the_identity(device: Device) -> None:
    """A device that was never calibrated has identity matrices, no offsets, and created_s 0."""
    import numpy as np

    _, info = device.get_info()
    if info.calibration_sequence != 0:
        raise NotObservedError(f"the device was calibrated: sequence {info.calibration_sequence}")
    data = device.read_calibration()
    record = decoded(data)
    if record.created_s != 0:
        raise BrokenRuleError("created_s 0", record.created_s, data[:SLOTS_AT])
    if record.slots.offset.any() or not (record.slots.matrix == np.eye(3).ravel()).all():
        raise BrokenRuleError("identity matrices and no offsets", "others", data)


@GROUP.check("Calibration", WRITES)
def staging_changes_nothing_in_use(device: Device) -> None:
    """calibration_write tells the bytes written, and leaves the record in use alone."""
    original = device.read_calibration()
    _, info = device.get_info()
    other = other_record(original)
    for offset in range(0, len(other), CHUNK_BYTES):
        chunk = other[offset : offset + CHUNK_BYTES]
        reply = device.accepted(CommandCode.CALIBRATION_WRITE, offset, chunk)
        expect(reply.ack.value == len(chunk), f"ACK.value {len(chunk)}", reply.ack.value, reply.frame)
    expect_in_use(device, original, info.calibration_sequence)


@GROUP.check("Calibration", WRITES)
def writing_nothing_is_refused(device: Device) -> None:
    """calibration_write without data is a bad_argument."""
    device.answered(AckCode.BAD_ARGUMENT, CommandCode.CALIBRATION_WRITE, 0, b"")


@GROUP.check("Calibration", WRITES)
def writing_beyond_the_end_is_refused(device: Device) -> None:
    """calibration_write takes bytes up to the end of a record, and refuses one more as bad_argument."""
    size = device.accepted(CommandCode.CALIBRATION_READ, 0).ack.value
    device.accepted(CommandCode.CALIBRATION_WRITE, size - 1, b"\x01")
    for offset, count in ((size, 1), (size - 1, 2), (65_536, 1), (2**32 - 1, 2)):
        device.answered(AckCode.BAD_ARGUMENT, CommandCode.CALIBRATION_WRITE, offset, bytes(count))


@GROUP.check("COMMAND", WRITES)
def too_much_data_is_refused(device: Device) -> None:
    """A COMMAND whose data_count is above 192 is refused, and the next one is taken."""
    tag = device.next_tag()
    packet = command_packet(CommandCode.CALIBRATION_WRITE, 0, b"", tag)[:-1] + bytes([193]) + bytes(193)
    reply = device.try_packet(packet, tag)
    if reply is None:
        raise BrokenRuleError("an ACK for a COMMAND with 193 bytes of data", "none", encode_frame(packet))
    expect(
        reply.ack.code == AckCode.BAD_LENGTH,
        "bad_length for 193 bytes of data",
        code_name(reply.ack.code),
        reply.frame,
    )
    device.get_status()


@GROUP.check("Calibration", WRITES)
def commit_with_wrong_crc_is_refused(device: Device) -> None:
    """A commit with another CRC than that of the staged record, sound or not, is bad_crc; the old stays."""
    original = device.read_calibration()
    _, info = device.get_info()
    other = other_record(original)
    for staged in (other, with_bytes(other, LAYOUT_AT, b"\x02\x00")):
        device.stage_calibration(staged)
        device.answered(
            AckCode.BAD_CRC, CommandCode.CALIBRATION_COMMIT, crc32(staged) ^ 1, timeout_s=COMMIT_PATIENCE_S
        )
    expect_in_use(device, original, info.calibration_sequence)


@GROUP.check("Calibration", WRITES)
def commit_of_wrong_layout_is_refused(device: Device) -> None:
    """A record of another layout is a bad_argument; the old record stays."""
    expect_refused(device, lambda record: with_bytes(record, LAYOUT_AT, b"\x02\x00"))


@GROUP.check("Calibration", WRITES)
def commit_of_wrong_slot_count_is_refused(device: Device) -> None:
    """A record for another number of slots is a bad_argument; the old record stays."""
    expect_refused(
        device, lambda record: with_bytes(record, SLOT_COUNT_AT, bytes([record[SLOT_COUNT_AT] - 1]))
    )


@GROUP.check("Calibration", WRITES)
def commit_of_numbers_that_are_none_is_refused(device: Device) -> None:
    """A record with a NaN or an infinity is a bad_argument, wherever it stands; the old record stays."""
    last = len(device.read_calibration()) - 4
    for at, value in (
        (PITCH_AT, math.nan),
        (HORIZONTAL_AT, math.inf),
        (SLOTS_AT, math.nan),
        (last, -math.inf),
    ):
        expect_refused(device, partial(with_float, at=at, value=value))


@GROUP.check("Calibration", WRITES)
def commit_of_values_out_of_range_is_refused(device: Device) -> None:
    """A record with mag_axes, pitch_m or a field out of its range is a bad_argument; the old record stays."""
    expect_refused(device, lambda record: with_bytes(record, MAG_AXES_AT, b"\x01"))
    for at, (_, high) in (
        (PITCH_AT, CALIBRATION_PITCH_M_RANGE),
        (HORIZONTAL_AT, CALIBRATION_FIELD_HORIZONTAL_UT_RANGE),
        (DOWN_AT, CALIBRATION_FIELD_DOWN_UT_RANGE),
    ):
        expect_refused(device, partial(with_float, at=at, value=2.0 * high))


@GROUP.check("Calibration", WRITES)
def commit_puts_a_record_in_use(device: Device) -> None:
    """A record committed in 5 s, staged in any order, is in use: sequence + 1, read back as written."""
    original = device.read_calibration()
    _, info = device.get_info()
    other = other_record(original)
    for offset in reversed(range(0, len(other), CHUNK_BYTES)):
        device.accepted(CommandCode.CALIBRATION_WRITE, offset, other[offset : offset + CHUNK_BYTES])
    reply = device.accepted(CommandCode.CALIBRATION_COMMIT, crc32(other), timeout_s=COMMIT_PATIENCE_S)
    sequence = (info.calibration_sequence + 1) % 2**32
    expect(reply.ack.value == sequence, f"ACK.value {sequence}", reply.ack.value, reply.frame)
    expect_in_use(device, other, sequence)


@GROUP.check("Calibration", WRITES)
def commit_of_the_record_in_use_changes_nothing(device: Device) -> None:
    """A commit of a record equal to the one in use is ok and leaves the sequence."""
    original = device.read_calibration()
    _, info = device.get_info()
    for _ in range(2):
        reply = device.commit_calibration(original)
        expect(
            reply.ack.value == info.calibration_sequence,
            f"ACK.value {info.calibration_sequence}, the sequence in use",
            reply.ack.value,
            reply.frame,
        )
    expect_in_use(device, original, info.calibration_sequence)


def expect_described(device: Device, record: bytes) -> None:
    """Raises BrokenRuleError unless INFO tells the pitch and the axes of this record."""
    frame, info = device.get_info()
    (pitch_m,) = struct.unpack_from("<f", record, PITCH_AT)
    expect(info.pitch_m == pitch_m, f"pitch_m {pitch_m:.6g} of the record in use", info.pitch_m, frame)
    wanted = Axes.X | Axes.Y | (Axes.Z if record[MAG_AXES_AT] == 3 else Axes(0))
    for slot in range(1, len(info.slots), 2):
        if info.slots.part[slot] != Part.NONE:
            axes = int(info.slots.axes[slot])
            expect(axes == wanted, f"axes {wanted:d} of the record in use in slot {slot}", axes, frame)


@GROUP.check("Calibration", WRITES)
def info_follows_the_record(device: Device) -> None:
    """INFO tells the pitch of the record in use, and of a magnetometer x and y or all axes, as it says."""
    original = device.read_calibration()
    expect_described(device, original)
    (pitch_m,) = struct.unpack_from("<f", original, PITCH_AT)
    other = with_float(original, PITCH_AT, pitch_m * (0.5 if pitch_m > 0.01 else 2.0))
    other = with_bytes(other, MAG_AXES_AT, bytes([5 - original[MAG_AXES_AT]]))
    device.commit_calibration(other)
    expect_described(device, other)
