# Generated from protocol/schema.toml by protocol/generate.py; change that and run it.
"""What goes over the wire between a ribbon and its host: packets as values, and their bytes.

An array of structures is a structure of NumPy arrays with a row for each item, which knows its count. Values
of an enumeration that this version does not know stay plain integers, flags it does not know are kept.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from operator import index
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt


class WireError(ValueError):
    """A value cannot be encoded, or bytes cannot be decoded; the message is one sentence that says why."""


class UnknownPacketError(WireError):
    """A packet of a type that this version does not know: skip it and count it."""


class MalformedPacketError(WireError):
    """Bytes that end before their fields do, or have a count above its limit."""


_Enum = TypeVar("_Enum", bound=IntEnum)
_THREE = np.arange(3)
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
# Where w, x, y, z stand in [largest, first, second, third], for each index of the largest.
_PLACES = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [1, 2, 0, 3], [1, 2, 3, 0]])
_SQRT_2 = np.float32(1.41421356)


def _member(kind: type[_Enum], value: int) -> _Enum | int:
    try:
        return kind(value)
    except ValueError:
        return value


def _take_fixed(layout: struct.Struct, data: bytes, at: int, name: str) -> tuple[Any, ...]:
    if len(data) - at < layout.size:
        least = at + layout.size
        raise MalformedPacketError(f"{name} ends after {len(data)} bytes, but takes at least {least}.")
    return layout.unpack_from(data, at)


def _end_of_items(data: bytes, at: int, count: int, limit: int, item_bytes: int, name: str) -> int:
    if count > limit:
        raise MalformedPacketError(f"{name} has a count of {count}, more than the {limit} it may have.")
    end = at + count * item_bytes
    if len(data) < end:
        raise MalformedPacketError(f"{name} ends after {len(data)} bytes, but its counts say {end} or more.")
    return end


def _checked_count(count: int, limit: int, name: str) -> int:
    if count > limit:
        raise WireError(f"{name} has {count} items, more than the {limit} it may have.")
    return count


def _checked_int(value: int, low: int, high: int, name: str) -> int:
    try:
        number = index(value)
    except TypeError:
        raise WireError(f"{name} is {value!r}, but must be an integer.") from None
    if not low <= number <= high:
        raise WireError(f"{name} is {number}, but must be {low} to {high}.")
    return number


def _checked_float(value: float, name: str) -> float:
    try:
        struct.pack("<f", value)
    except (struct.error, OverflowError):
        raise WireError(f"{name} is {value!r}, which is no number of single precision.") from None
    return value


def _checked_bytes(value: bytes, low: int, high: int, name: str) -> bytes:
    if not isinstance(value, bytes | bytearray | memoryview) or not low <= len(value) <= high:
        raise WireError(f"{name} must be {low} to {high} bytes, not {value!r}.")
    return bytes(value)


def _scaled(value: float, scale: float, low: int, high: int, invalid: int) -> int:
    """Steps of `scale`, rounded half away from zero and kept within low ... high; NaN: `invalid`."""
    with np.errstate(over="ignore"):
        steps = np.float32(value) / np.float32(scale)
    if math.isnan(steps):
        return invalid
    if steps <= low or steps >= high:
        return low if steps < 0 else high
    return int(steps + np.copysign(np.float32(0.5), steps))


def _checked_ints(
    values: npt.ArrayLike, shape: tuple[int, ...], low: int, high: int, name: str
) -> npt.NDArray[np.integer[Any]]:
    array = np.asarray(values)
    if array.shape != shape or array.dtype.kind not in "iub":
        raise WireError(f"{name} is {array.dtype} {array.shape}, but must be integers {shape}.")
    if array.size and not low <= array.min() <= array.max() <= high:
        raise WireError(f"{name} holds {array.min()} to {array.max()}, but must be {low} to {high}.")
    return array


def _checked_floats(values: npt.ArrayLike, shape: tuple[int, ...], name: str) -> npt.NDArray[np.float32]:
    array = np.asarray(values)
    if array.shape != shape or array.dtype.kind not in "iubf":
        raise WireError(f"{name} is {array.dtype} {array.shape}, but must be numbers {shape}.")
    with np.errstate(over="ignore", invalid="ignore"):
        single = array.astype(np.float32)
    if (np.isinf(single) & np.isfinite(array)).any():
        raise WireError(f"{name} holds numbers beyond single precision.")
    return single


def _doubles(singles: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    with np.errstate(invalid="ignore"):  # a signalling NaN
        return singles.astype(np.float64)


def _i24_to_octets(values: npt.NDArray[np.integer[Any]]) -> npt.NDArray[np.uint8]:
    return values.astype("<i4")[..., np.newaxis].view(np.uint8)[..., :3]


def _i24_from_octets(octets: npt.NDArray[np.uint8]) -> npt.NDArray[np.int32]:
    parts = octets.astype(np.int32)
    values = parts[..., 0] | parts[..., 1] << 8 | parts[..., 2] << 16
    return (values ^ 0x800000) - 0x800000


def _words_to_octets(words: npt.NDArray[np.uint64], word_bytes: int) -> npt.NDArray[np.uint8]:
    return words.astype("<u8").reshape(-1, 1).view(np.uint8)[:, :word_bytes]


def _words_from_octets(octets: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
    words = np.zeros((len(octets), 8), np.uint8)
    words[:, : octets.shape[1]] = octets
    return words.view("<i8")[:, 0]


def _smallest_three(
    q_in: npt.ArrayLike, valid_in: npt.ArrayLike, count: int, name: str, *, bits: int, flag: int, invalid: int
) -> npt.NDArray[np.uint64]:
    """Words of the quaternions (n, 4) that are valid (n,) and can be normalised; `invalid` for the others.

    In single precision and in the order of operations of the C header, which explains them, so that both give
    the same bytes.
    """
    valid = np.asarray(valid_in)
    if valid.shape != (count,) or valid.dtype != np.bool_:
        raise WireError(f"{name} has a valid of {valid.dtype} {valid.shape}, but it must be bool {(count,)}.")
    q = np.asarray(q_in)
    if q.shape != (count, 4) or q.dtype.kind not in "iuf":
        raise WireError(f"{name} is {q.dtype} {q.shape}, but must be numbers {(count, 4)}.")
    levels = (1 << (bits - 1)) - 1
    with np.errstate(all="ignore"):
        q = q.astype(np.float32)
        square = q * q
        norm2 = (square[:, 0] + square[:, 1]) + (square[:, 2] + square[:, 3])
        good = valid & (norm2 >= np.finfo(np.float32).tiny) & (norm2 <= np.finfo(np.float32).max)
    q, norm2 = q[good], norm2[good]
    rows = np.arange(len(q))
    largest = np.abs(q).argmax(axis=1)
    steps = np.float32(levels) * _SQRT_2 / np.sqrt(norm2)
    scale = np.where(q[rows, largest] < 0, -steps, steps)
    inverse = np.float32(1) / (q[rows, largest] * scale)
    x = q[rows[:, np.newaxis], _OTHERS[largest]] * scale[:, np.newaxis]
    codes = (x + np.float32(levels + 0.5)).astype(np.int64)
    error = (codes - levels).astype(np.float32) - x
    ratio = x * inverse[:, np.newaxis]
    shares = ratio * error
    s = ((shares[:, 0] + shares[:, 1]) + shares[:, 2])[:, np.newaxis]
    step = np.where(error < 0, np.float32(-1), np.float32(1))
    change = (1 - 2 * np.abs(error)) + ratio * (ratio - 2 * s * step)
    best = change.argmin(axis=1)
    better = change[rows, best] < 0
    codes[rows, best] -= np.where(better, step[rows, best], 0).astype(np.int64)
    words = np.full(count, invalid, np.uint64)
    words[good] = largest | flag | (codes << 2 + bits * _THREE).sum(axis=1)
    return words


def _smallest_three_inverse(
    words: npt.NDArray[np.int64], valid: npt.NDArray[np.bool_], bits: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Unit quaternions (n, 4), NaN where not valid; valid (n,), false too if the three exceed length 1."""
    levels = (1 << (bits - 1)) - 1
    steps = (words[:, np.newaxis] >> 2 + bits * _THREE & (2 << bits - 1) - 1) - levels
    whole = 2 * levels * levels  # 1, squared, in steps
    rest = whole - np.einsum("ij,ij->i", steps, steps)
    valid = valid & (rest >= 0)
    parts = np.empty((len(words), 4))
    parts[:, 0] = np.sqrt(np.abs(rest) / whole)
    parts[:, 1:] = steps * (math.sqrt(0.5) / levels)
    parts[~valid] = np.nan
    return parts[np.arange(len(words))[:, np.newaxis], _PLACES[words & 3]], valid


WIRE_VERSION = 2
OLDEST_HOST_VERSION = 1
SCHEMA_HASH = 0x00337FC8
MAX_PACKET_BYTES = 576
NODE_MAX = 32
SLOT_MAX = 64
# `layout` of the calibration record defined here.
CALIBRATION_LAYOUT = 1
# longest blinking that identify accepts.
IDENTIFY_MAX_MS = 60000
# argument of enter_dfu, "DFU!" read little-endian: keeps a stray command from stopping a device.
ENTER_DFU_KEY = 0x21554644
CALIBRATION_MAG_AXES_RANGE = (2, 3)
CALIBRATION_PITCH_M_RANGE = (0.001, 1.0)
CALIBRATION_FIELD_HORIZONTAL_UT_RANGE = (1.0, 100.0)
CALIBRATION_FIELD_DOWN_UT_RANGE = (-100.0, 100.0)
INFO_RATE_HZ_RANGE = (1, 200)
INFO_RATE_MAX_HZ_RANGE = (1, 200)
COMMAND_DATA_COUNT_RANGE = (0, 192)
ACK_DATA_COUNT_RANGE = (0, 192)
SIGMA_UNKNOWN = 15


class PacketId(IntEnum):
    """Type byte of a packet."""

    # Who the device is. Sent once at start and on get_info.
    INFO = 1
    # Orientations of all nodes from one scan.
    ORIENT = 2
    # ORIENT for slow links.
    ORIENT_COMPACT = 3
    # All readings of one scan, for calibration and re-processing.
    RAW = 4
    # Health, once a second and on get_status. Counters run since start and wrap.
    STATUS = 5
    # Asks for something. Answered by one ACK with the same tag; a host repeats it after 0.25 s.
    COMMAND = 16
    # Ends a COMMAND.
    ACK = 17
    # Answered at once by CLOCK_PONG, to find the device clock's offset and drift.
    CLOCK_PING = 18
    # Answer to CLOCK_PING.
    CLOCK_PONG = 19


class Part(IntEnum):
    """What a slot of the sensor string holds, found by its identity register."""

    # nothing answered, or an identity that no driver knows
    NONE = 0
    # three-axis accelerometer, 14 bit
    LIS2DW12 = 1
    # AMR magnetometer, 18 bit, with set/reset coil
    MMC5983MA = 2
    # AMR magnetometer, 12 bit
    HMC5983 = 3


class SlotReason(IntEnum):
    """Why the reading of a slot is not used; 0 while it is."""

    # the reading is fresh and plausible
    OK = 0
    # nothing answers: the bus reads all ones or all zeros
    ABSENT = 1
    # something answers with an identity that no driver knows
    WRONG_ID = 2
    # being brought up, or lost its configuration
    NOT_CONFIGURED = 3
    # no new sample for longer than four sample periods of the part
    STALE = 4
    # new samples, but the same counts over and over
    STUCK = 5
    # an axis is at the end of its range
    SATURATED = 6
    # |a| or |B| far outside what the calibrated part can read here
    OUT_OF_RANGE = 7
    # jumps that no motion explains: bit flips or a loose contact
    NOISY = 8


class ResetCause(IntEnum):
    """Why the device last started."""

    # the device cannot tell
    UNKNOWN = 0
    # power applied
    POWER_ON = 1
    # reset pin
    PIN = 2
    # asked for by the firmware
    SOFTWARE = 3
    # the main loop made no progress
    WATCHDOG = 4
    # supply voltage dipped
    BROWN_OUT = 5
    # a fault handler restarted the device; fault_* tell where
    HARD_FAULT = 6


class ClockSource(IntEnum):
    """What times the device."""

    # the device cannot tell
    UNKNOWN = 0
    # external crystal: tens of ppm
    CRYSTAL = 1
    # the crystal did not start; internal RC oscillator, about 1 %
    INTERNAL_RC = 2
    # the firmware runs on a computer
    HOST = 3


class Board(IntEnum):
    """The circuit board the firmware was built for."""

    # a computer: the firmware as a module
    HOST = 0
    # pyboard v1.1
    PYBOARD_V11 = 1
    # Feather STM32F405
    FEATHER_F405 = 2


class CommandCode(IntEnum):
    """What a COMMAND asks for. `argument` and `data` are 0 and empty unless said otherwise."""

    # ACK, then an INFO packet
    GET_INFO = 1
    # ACK, then a STATUS packet
    GET_STATUS = 2
    # argument: scans a second, 1 to 200 Hz, at most INFO.rate_max_hz. ACK.value: the rate in use. The
    # sequence goes on, the phase starts anew
    SET_RATE = 3
    # argument: flags.mode. orient and orient_compact exclude each other; unknown bits are a bad_argument.
    # ACK.value: the mode in use
    SET_MODE = 4
    # argument: a device time, microseconds, at which a scan shall start; later (and earlier) scans stay
    # whole periods away. Lets a host make several ribbons sample together. ACK.value: microseconds by
    # which the scans moved, as a signed 32-bit integer, at most half a period
    SET_PHASE = 5
    # argument: milliseconds to blink for, 0 to identify_max_ms (60000), more is a bad_argument; 0 ends it
    IDENTIFY = 6
    # argument: offset in bytes into the calibration record in use. ACK.value: size of the record,
    # ACK.data: bytes from there, at most 192, none at or beyond the end
    CALIBRATION_READ = 7
    # argument: offset in bytes, data: 1 to 192 bytes for the staging area. Beyond the size of a record:
    # bad_argument. ACK.value: bytes written
    CALIBRATION_WRITE = 8
    # argument: CRC-32 of the staged record. The record is checked (CRC, layout, slot count, ranges,
    # finite numbers), stored atomically, then used; one equal to that in use is ok and changes nothing.
    # ACK.value: the calibration sequence in use
    CALIBRATION_COMMIT = 9
    # argument: enter_dfu_key (0x21554644), else bad_argument. ACK, then the ROM boot loader; a device
    # without one answers unsupported
    ENTER_DFU = 10


class AckCode(IntEnum):
    """How a COMMAND ended."""

    # done
    OK = 0
    # the device does not know this command
    UNKNOWN_COMMAND = 1
    # argument or data out of range
    BAD_ARGUMENT = 2
    # the packet is shorter than its fields say, or data_count is out of range
    BAD_LENGTH = 3
    # the staged record does not have the CRC given
    BAD_CRC = 4
    # flash could not be erased or written; the old record is still in use
    STORAGE_FAILED = 5
    # known, but this board cannot do it
    UNSUPPORTED = 6


class Mode(IntFlag):
    """What the device sends after each scan."""

    # ORIENT
    ORIENT = 1
    # ORIENT_COMPACT
    ORIENT_COMPACT = 2
    # RAW
    RAW = 4


class Axes(IntFlag):
    """Which axes of a part are used, in the node frame."""

    # along the tangent
    X = 1
    # along the binormal
    Y = 2
    # along the normal
    Z = 4


class Quality(IntFlag):
    """Upper four bits of a node's quality byte: why its orientation deserves less trust. The lower four
    bits are sigma_code."""

    # the accelerometers are not a level now: |a| differs from g, or they change
    MOVING = 16
    # |B| does not fit
    FIELD_MAGNITUDE = 32
    # the dip angle does not fit
    FIELD_DIP = 64
    # two headings explain the two-axis field, of which one was chosen by continuity, or a wide range does
    HEADING_AMBIGUOUS = 128


class Misfit(IntFlag):
    """What a slot reads at rest, or on the whole, that its calibration does not explain."""

    # |a| is outside 0.99 to 1.01 g, or |B| not that of the local field
    LENGTH = 1
    # an accelerometer's level is not the one that its neighbours read
    NEIGHBOURS = 2
    # the dip angle of the field is not the local one
    DIP = 4


@dataclass(frozen=True, eq=False)
class SlotInfoArray:
    """One slot of the sensor string, in order of distance from the connector; slot i sits at i * pitch.
    One row each.

    part: (n,); the part found
    axes: (n,); axes that are used
    lsb: (n,); m/s^2 or uT a count; what one count of RAW is, before calibration; 0 when absent
    """

    part: npt.NDArray[np.uint8]
    axes: npt.NDArray[np.uint8]
    lsb: npt.NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.part)


@dataclass(frozen=True, eq=False)
class SlotStatusArray:
    """Health of one slot. One row each.

    reason: (n,); state now
    errors: (n,); scans without a usable reading since start, stops at 65535
    """

    reason: npt.NDArray[np.uint8]
    errors: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.reason)


@dataclass(frozen=True, eq=False)
class NodeArray:
    """Orientation of one node, at the place of a magnetometer. One row each.

    q_world_node: (n, 4), NaN where not valid; world from node; 48 bits: index of the largest component in
        bits 0 and 1, the other three in order w, x, y, z in bits 2 to 16, 17 to 31 and 32 to 46; bit 47
        is set when valid, all bits are 0 when not
    valid: (n,)
    quality: (n,); sigma_code in bits 0 to 3, flags.quality in bits 4 to 7
    """

    q_world_node: npt.NDArray[np.float64]
    valid: npt.NDArray[np.bool_]
    quality: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.q_world_node)


@dataclass(frozen=True, eq=False)
class NodeCompactArray:
    """Orientation of one node in 32 bits. One row each.

    q_world_node: (n, 4), NaN where not valid; world from node; 32 bits: index of the largest component in
        bits 0 and 1, the other three in order w, x, y, z in bits 2 to 11, 12 to 21 and 22 to 31; all bits
        are set when invalid
    valid: (n,)
    quality: (n,); as in node
    """

    q_world_node: npt.NDArray[np.float64]
    valid: npt.NDArray[np.bool_]
    quality: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.q_world_node)


@dataclass(frozen=True, eq=False)
class SlotHealthArray:
    """How well one slot's calibration fits. One row each.

    misfit: (n,); what does not fit; 0: nothing was found
    length_permille: (n,); by how much |a| at rest exceeds g, or |B| the local field; 127: by that or
        more; -127: falls short by that or more; -128: not known
    """

    misfit: npt.NDArray[np.uint8]
    length_permille: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.misfit)


@dataclass(frozen=True, eq=False)
class AccelRawArray:
    """One accelerometer reading. One row each.

    reason: (n,); ok, or why the counts are not usable
    counts: (n, 3); slot_info.lsb; part; x, y, z specific force as read
    """

    reason: npt.NDArray[np.uint8]
    counts: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.reason)


@dataclass(frozen=True, eq=False)
class MagRawArray:
    """One magnetometer reading. One row each.

    reason: (n,); ok, or why the counts are not usable
    counts: (n, 3); slot_info.lsb; part; x, y, z field as read, null field at 0, the part's own bridge
        offset already cancelled where it can be
    """

    reason: npt.NDArray[np.uint8]
    counts: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.reason)


@dataclass(frozen=True, eq=False)
class SlotCalibrationArray:
    """What turns a part's reading v (SI) into the node frame: matrix * (v - offset). One row each.

    offset: (n, 3); m/s^2 or uT; part; bias, or hard iron
    matrix: (n, 9); node from part; row-major: scale, cross-axis, soft iron and mounting in one
    """

    offset: npt.NDArray[np.float64]
    matrix: npt.NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.offset)


@dataclass(frozen=True, eq=False)
class Calibration:
    """All that a device knows of its sensors. `layout` is 1.

    layout: 1
    mag_axes: 2: only x and y of the magnetometers are used, as the part names its axes: what it does not
        measure lies along the third column of its slot's matrix; 3: all
    created_s: s since 1970-01-01 UTC; 0: invalid; when it was made; 0: the identity calibration of an
        uncalibrated device
    pitch_m: m; distance between neighbouring slots
    field_horizontal_ut: uT; horizontal part of the local field
    field_down_ut: uT; vertical part of the local field, positive down
    slots: one a slot, identity where nothing is known
    """

    layout: int
    mag_axes: int
    created_s: int
    pitch_m: float
    field_horizontal_ut: float
    field_down_ut: float
    slots: SlotCalibrationArray

    def pack(self) -> bytes:
        """The bytes of the record. Raises WireError if a value does not fit in its field."""
        return _encode_calibration(self)

    @staticmethod
    def unpack(record: bytes) -> Calibration:
        """The record in these bytes.

        Raises MalformedPacketError if they are too few or too many.
        """
        calibration, surplus = _decode_calibration(record)
        if surplus:
            raise MalformedPacketError(f"Calibration has {surplus} bytes too many.")
        return calibration


@dataclass(frozen=True, eq=False)
class Info:
    """Who the device is. Sent once at start and on get_info.

    wire_version: version of this schema the device speaks
    oldest_host_version: a host that speaks an older version than this cannot work with the device
    schema_hash: first four bytes, read little-endian, of the SHA-256 of the schema's layout
    firmware_version: major, minor, patch
    board: circuit board
    unique_id: of the MCU; its hexadecimal form is the serial number
    pitch_m: m; distance between neighbouring slots
    rate_hz: Hz; scans a second
    rate_max_hz: Hz; largest rate that set_rate accepts
    mode: what is sent after each scan
    calibration_sequence: counts commits; 0: never calibrated
    calibration_crc32: CRC-32 of the calibration record in use
    node_count: orientations in ORIENT
    slots: one a slot
    """

    wire_version: int
    oldest_host_version: int
    schema_hash: int
    firmware_version: bytes
    board: Board | int
    unique_id: bytes
    pitch_m: float
    rate_hz: int
    rate_max_hz: int
    mode: Mode
    calibration_sequence: int
    calibration_crc32: int
    node_count: int
    slots: SlotInfoArray


@dataclass(frozen=True, eq=False)
class Orient:
    """Orientations of all nodes from one scan.

    t_us: us; device time at the end of the scan, wraps every 71.6 minutes
    sequence: counts scans, wraps; the same in ORIENT and RAW of one scan
    nodes: from the connector outward
    """

    t_us: int
    sequence: int
    nodes: NodeArray


@dataclass(frozen=True, eq=False)
class OrientCompact:
    """ORIENT for slow links.

    t_us: us; as in ORIENT
    sequence: as in ORIENT
    nodes: from the connector outward
    """

    t_us: int
    sequence: int
    nodes: NodeCompactArray


@dataclass(frozen=True, eq=False)
class Raw:
    """All readings of one scan, for calibration and re-processing.

    t_us: us; as in ORIENT
    sequence: as in ORIENT
    accels: from the connector outward
    mags: from the connector outward
    accel_age_us: us; how old the accelerometers' readings are at t_us, on average: since the middle of
        the time that a reading is a mean over
    accel_period_us: us; between samples of accelerometers that sample by clocks of their own: the age is
        up to half of it more or less; 0: they sample when the scan tells them to
    accel_span_us: us; time that a reading of an accelerometer is a mean over
    mag_age_us: us; the same of the magnetometers
    mag_period_us: us; the same of the magnetometers
    mag_span_us: us; the same of the magnetometers
    """

    t_us: int
    sequence: int
    accels: AccelRawArray
    mags: MagRawArray
    accel_age_us: int
    accel_period_us: int
    accel_span_us: int
    mag_age_us: int
    mag_period_us: int
    mag_span_us: int


@dataclass(frozen=True, eq=False)
class Status:
    """Health, once a second and on get_status. Counters run since start and wrap.

    t_us: us; device time
    uptime_s: s; since start
    scans: scans done
    overruns: scans left out because the one before took too long
    frames_dropped: frames given up because the link was slower than they came
    rx_crc_errors: frames received with a wrong CRC
    rx_malformed: frames received that are no COBS, too short for a packet and its CRC, or too long;
        packets shorter than their fields that no ACK can answer
    rx_unknown: packets received of a type that is not known, or that only a device sends
    scan_us: us; how long the last scan took
    rate_hz: Hz; scans a second
    mode: what is sent after each scan
    reset_cause: why the device last started
    clock_source: what times the device
    temperature_c: degC; NaN: invalid; of the MCU, or of the sensors if it has none
    fault_pc: 0: invalid; program counter of the last hard fault; 0: none
    fault_lr: 0: invalid; link register there
    fault_cfsr: 0: invalid; configurable fault status register there
    slots: one a slot
    health: one a slot
    """

    t_us: int
    uptime_s: int
    scans: int
    overruns: int
    frames_dropped: int
    rx_crc_errors: int
    rx_malformed: int
    rx_unknown: int
    scan_us: int
    rate_hz: int
    mode: Mode
    reset_cause: ResetCause | int
    clock_source: ClockSource | int
    temperature_c: float
    fault_pc: int
    fault_lr: int
    fault_cfsr: int
    slots: SlotStatusArray
    health: SlotHealthArray


@dataclass(frozen=True)
class Command:
    """Asks for something. Answered by one ACK with the same tag; a host repeats it after 0.25 s.

    tag: chosen by the host, comes back in the ACK
    command: what
    argument: meaning depends on the command
    data: meaning depends on the command
    """

    tag: int
    command: CommandCode | int
    argument: int
    data: bytes = b""


@dataclass(frozen=True)
class Ack:
    """Ends a COMMAND.

    tag: of the COMMAND
    command: of the COMMAND
    code: how it ended
    value: meaning depends on the command
    data: meaning depends on the command
    """

    tag: int
    command: int
    code: AckCode | int
    value: int
    data: bytes = b""


@dataclass(frozen=True)
class ClockPing:
    """Answered at once by CLOCK_PONG, to find the device clock's offset and drift.

    tag: comes back
    t_host_us: us; host time of sending, comes back
    """

    tag: int
    t_host_us: int


@dataclass(frozen=True)
class ClockPong:
    """Answer to CLOCK_PING.

    tag: of the CLOCK_PING
    t_host_us: us; of the CLOCK_PING
    t_receive_us: us; device time when the last byte of the CLOCK_PING was read
    t_transmit_us: us; device time when this packet was put on the way
    """

    tag: int
    t_host_us: int
    t_receive_us: int
    t_transmit_us: int


Packet = Info | Orient | OrientCompact | Raw | Status | Command | Ack | ClockPing | ClockPong


def sigma_rad(quality: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """Standard deviation of orientations, rad, largest axis, from quality bytes; NaN where unknown."""
    sigma: npt.NDArray[np.float64] = _SIGMA_RAD[np.asarray(quality) & 15]
    return sigma


def sigma_code(sigma_rad: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """The code, bits 0 to 3 of a quality byte, of standard deviations in rad; negative or NaN: unknown."""
    sigma = np.asarray(sigma_rad, np.float32)
    codes = np.minimum(np.searchsorted(_SIGMA_RAD[:-1].astype(np.float32), sigma), SIGMA_UNKNOWN - 1)
    return np.where(sigma >= 0, codes, SIGMA_UNKNOWN).astype(np.uint8)


def encode(packet: Packet) -> bytes:
    """Type byte and fields. Raises WireError if a value does not fit in its field."""
    encoder = _ENCODERS.get(type(packet))
    if encoder is None:
        raise WireError(f"{packet!r} is not a packet.")
    return encoder(packet)


def decode(packet: bytes) -> tuple[Packet, int]:
    """The packet in these bytes, and how many surplus bytes follow the fields that this version knows.

    Raises UnknownPacketError for a type it does not know, and MalformedPacketError if the bytes end before
    their fields do or a count is above its limit; nothing else, whatever the bytes are.
    """
    if not packet:
        raise MalformedPacketError("A packet without a type byte.")
    decoder = _DECODERS.get(packet[0])
    if decoder is None:
        raise UnknownPacketError(f"A packet of type 0x{packet[0]:02x}, which this version does not know.")
    return decoder(packet)


_SLOT_INFO = np.dtype(
    [
        ("part", "<u1"),
        ("axes", "<u1"),
        ("lsb", "<f4"),
    ]
)


def _write_slot_info(items: SlotInfoArray, count: int, name: str) -> bytes:
    rows = np.empty(count, _SLOT_INFO)
    part = _checked_ints(items.part, (count,), 0, 255, f"{name}.part")
    rows["part"] = part
    axes = _checked_ints(items.axes, (count,), 0, 255, f"{name}.axes")
    rows["axes"] = axes
    rows["lsb"] = _checked_floats(items.lsb, (count,), f"{name}.lsb")
    return rows.tobytes()


def _read_slot_info(octets: bytes, at: int, count: int) -> SlotInfoArray:
    rows = np.frombuffer(octets, _SLOT_INFO, count, at)
    part = rows["part"].astype(np.uint8)
    axes = rows["axes"].astype(np.uint8)
    lsb = _doubles(rows["lsb"])
    return SlotInfoArray(
        part=part,
        axes=axes,
        lsb=lsb,
    )


_SLOT_STATUS = np.dtype(
    [
        ("reason", "<u1"),
        ("errors", "<u2"),
    ]
)


def _write_slot_status(items: SlotStatusArray, count: int, name: str) -> bytes:
    rows = np.empty(count, _SLOT_STATUS)
    reason = _checked_ints(items.reason, (count,), 0, 255, f"{name}.reason")
    rows["reason"] = reason
    errors = _checked_ints(items.errors, (count,), 0, 65535, f"{name}.errors")
    rows["errors"] = errors
    return rows.tobytes()


def _read_slot_status(octets: bytes, at: int, count: int) -> SlotStatusArray:
    rows = np.frombuffer(octets, _SLOT_STATUS, count, at)
    reason = rows["reason"].astype(np.uint8)
    errors = rows["errors"].astype(np.int32)
    return SlotStatusArray(
        reason=reason,
        errors=errors,
    )


_NODE = np.dtype(
    [
        ("q_world_node", "u1", (6,)),
        ("quality", "<u1"),
    ]
)


def _write_node(items: NodeArray, count: int, name: str) -> bytes:
    rows = np.empty(count, _NODE)
    words = _smallest_three(
        items.q_world_node,
        items.valid,
        count,
        f"{name}.q_world_node",
        bits=15,
        flag=0x800000000000,
        invalid=0,
    )
    rows["q_world_node"] = _words_to_octets(words, 6)
    quality = _checked_ints(items.quality, (count,), 0, 255, f"{name}.quality")
    rows["quality"] = quality
    return rows.tobytes()


def _read_node(octets: bytes, at: int, count: int) -> NodeArray:
    rows = np.frombuffer(octets, _NODE, count, at)
    words = _words_from_octets(rows["q_world_node"])
    q_world_node, valid = _smallest_three_inverse(words, words & 0x800000000000 != 0, 15)
    quality = rows["quality"].astype(np.uint8)
    return NodeArray(
        q_world_node=q_world_node,
        valid=valid,
        quality=quality,
    )


_NODE_COMPACT = np.dtype(
    [
        ("q_world_node", "u1", (4,)),
        ("quality", "<u1"),
    ]
)


def _write_node_compact(items: NodeCompactArray, count: int, name: str) -> bytes:
    rows = np.empty(count, _NODE_COMPACT)
    words = _smallest_three(
        items.q_world_node,
        items.valid,
        count,
        f"{name}.q_world_node",
        bits=10,
        flag=0,
        invalid=0xFFFFFFFF,
    )
    rows["q_world_node"] = _words_to_octets(words, 4)
    quality = _checked_ints(items.quality, (count,), 0, 255, f"{name}.quality")
    rows["quality"] = quality
    return rows.tobytes()


def _read_node_compact(octets: bytes, at: int, count: int) -> NodeCompactArray:
    rows = np.frombuffer(octets, _NODE_COMPACT, count, at)
    words = _words_from_octets(rows["q_world_node"])
    q_world_node, valid = _smallest_three_inverse(words, words != 0xFFFFFFFF, 10)
    quality = rows["quality"].astype(np.uint8)
    return NodeCompactArray(
        q_world_node=q_world_node,
        valid=valid,
        quality=quality,
    )


_SLOT_HEALTH = np.dtype(
    [
        ("misfit", "<u1"),
        ("length_permille", "<i1"),
    ]
)


def _write_slot_health(items: SlotHealthArray, count: int, name: str) -> bytes:
    rows = np.empty(count, _SLOT_HEALTH)
    misfit = _checked_ints(items.misfit, (count,), 0, 255, f"{name}.misfit")
    rows["misfit"] = misfit
    length_permille = _checked_ints(items.length_permille, (count,), -128, 127, f"{name}.length_permille")
    rows["length_permille"] = length_permille
    return rows.tobytes()


def _read_slot_health(octets: bytes, at: int, count: int) -> SlotHealthArray:
    rows = np.frombuffer(octets, _SLOT_HEALTH, count, at)
    misfit = rows["misfit"].astype(np.uint8)
    length_permille = rows["length_permille"].astype(np.int32)
    return SlotHealthArray(
        misfit=misfit,
        length_permille=length_permille,
    )


_ACCEL_RAW = np.dtype(
    [
        ("reason", "<u1"),
        ("counts", "<i2", (3,)),
    ]
)


def _write_accel_raw(items: AccelRawArray, count: int, name: str) -> bytes:
    rows = np.empty(count, _ACCEL_RAW)
    reason = _checked_ints(items.reason, (count,), 0, 255, f"{name}.reason")
    rows["reason"] = reason
    counts = _checked_ints(items.counts, (count, 3), -32768, 32767, f"{name}.counts")
    rows["counts"] = counts
    return rows.tobytes()


def _read_accel_raw(octets: bytes, at: int, count: int) -> AccelRawArray:
    rows = np.frombuffer(octets, _ACCEL_RAW, count, at)
    reason = rows["reason"].astype(np.uint8)
    counts = rows["counts"].astype(np.int32)
    return AccelRawArray(
        reason=reason,
        counts=counts,
    )


_MAG_RAW = np.dtype(
    [
        ("reason", "<u1"),
        ("counts", "u1", (3, 3)),
    ]
)


def _write_mag_raw(items: MagRawArray, count: int, name: str) -> bytes:
    rows = np.empty(count, _MAG_RAW)
    reason = _checked_ints(items.reason, (count,), 0, 255, f"{name}.reason")
    rows["reason"] = reason
    counts = _checked_ints(items.counts, (count, 3), -8388608, 8388607, f"{name}.counts")
    rows["counts"] = _i24_to_octets(counts)
    return rows.tobytes()


def _read_mag_raw(octets: bytes, at: int, count: int) -> MagRawArray:
    rows = np.frombuffer(octets, _MAG_RAW, count, at)
    reason = rows["reason"].astype(np.uint8)
    counts = _i24_from_octets(rows["counts"])
    return MagRawArray(
        reason=reason,
        counts=counts,
    )


_SLOT_CALIBRATION = np.dtype(
    [
        ("offset", "<f4", (3,)),
        ("matrix", "<f4", (9,)),
    ]
)


def _write_slot_calibration(items: SlotCalibrationArray, count: int, name: str) -> bytes:
    rows = np.empty(count, _SLOT_CALIBRATION)
    rows["offset"] = _checked_floats(items.offset, (count, 3), f"{name}.offset")
    rows["matrix"] = _checked_floats(items.matrix, (count, 9), f"{name}.matrix")
    return rows.tobytes()


def _read_slot_calibration(octets: bytes, at: int, count: int) -> SlotCalibrationArray:
    rows = np.frombuffer(octets, _SLOT_CALIBRATION, count, at)
    offset = _doubles(rows["offset"])
    matrix = _doubles(rows["matrix"])
    return SlotCalibrationArray(
        offset=offset,
        matrix=matrix,
    )


_CALIBRATION_FIXED = struct.Struct("<HBBIfff")


def _encode_calibration(calibration: Calibration) -> bytes:
    slot_count = _checked_count(len(calibration.slots), SLOT_MAX, "Calibration.slots")
    pieces = [
        _CALIBRATION_FIXED.pack(
            _checked_int(calibration.layout, 0, 65535, "Calibration.layout"),
            _checked_int(calibration.mag_axes, 0, 255, "Calibration.mag_axes"),
            slot_count,
            _checked_int(calibration.created_s, 0, 4294967295, "Calibration.created_s"),
            _checked_float(calibration.pitch_m, "Calibration.pitch_m"),
            _checked_float(calibration.field_horizontal_ut, "Calibration.field_horizontal_ut"),
            _checked_float(calibration.field_down_ut, "Calibration.field_down_ut"),
        ),
        _write_slot_calibration(calibration.slots, slot_count, "Calibration.slots"),
    ]
    return b"".join(pieces)


def _decode_calibration(octets: bytes) -> tuple[Calibration, int]:
    at = 0
    (
        layout,
        mag_axes,
        slot_count,
        created_s,
        pitch_m,
        field_horizontal_ut,
        field_down_ut,
    ) = _take_fixed(_CALIBRATION_FIXED, octets, at, "Calibration")
    at += _CALIBRATION_FIXED.size
    end = _end_of_items(octets, at, slot_count, SLOT_MAX, _SLOT_CALIBRATION.itemsize, "Calibration")
    slots = _read_slot_calibration(octets, at, slot_count)
    at = end
    calibration = Calibration(
        layout=layout,
        mag_axes=mag_axes,
        created_s=created_s,
        pitch_m=pitch_m,
        field_horizontal_ut=field_horizontal_ut,
        field_down_ut=field_down_ut,
        slots=slots,
    )
    return calibration, len(octets) - at


_INFO_FIXED = struct.Struct("<BBBI3sB12sfHHBIIBB")


def _encode_info(info: Info) -> bytes:
    slot_count = _checked_count(len(info.slots), SLOT_MAX, "Info.slots")
    pieces = [
        _INFO_FIXED.pack(
            PacketId.INFO,
            _checked_int(info.wire_version, 0, 255, "Info.wire_version"),
            _checked_int(info.oldest_host_version, 0, 255, "Info.oldest_host_version"),
            _checked_int(info.schema_hash, 0, 4294967295, "Info.schema_hash"),
            _checked_bytes(info.firmware_version, 3, 3, "Info.firmware_version"),
            _checked_int(info.board, 0, 255, "Info.board"),
            _checked_bytes(info.unique_id, 12, 12, "Info.unique_id"),
            _checked_float(info.pitch_m, "Info.pitch_m"),
            _checked_int(info.rate_hz, 0, 65535, "Info.rate_hz"),
            _checked_int(info.rate_max_hz, 0, 65535, "Info.rate_max_hz"),
            _checked_int(info.mode, 0, 255, "Info.mode"),
            _checked_int(info.calibration_sequence, 0, 4294967295, "Info.calibration_sequence"),
            _checked_int(info.calibration_crc32, 0, 4294967295, "Info.calibration_crc32"),
            _checked_int(info.node_count, 0, 255, "Info.node_count"),
            slot_count,
        ),
        _write_slot_info(info.slots, slot_count, "Info.slots"),
    ]
    return b"".join(pieces)


def _decode_info(octets: bytes) -> tuple[Info, int]:
    at = 0
    (
        _,
        wire_version,
        oldest_host_version,
        schema_hash,
        firmware_version,
        board,
        unique_id,
        pitch_m,
        rate_hz,
        rate_max_hz,
        mode,
        calibration_sequence,
        calibration_crc32,
        node_count,
        slot_count,
    ) = _take_fixed(_INFO_FIXED, octets, at, "Info")
    at += _INFO_FIXED.size
    end = _end_of_items(octets, at, slot_count, SLOT_MAX, _SLOT_INFO.itemsize, "Info")
    slots = _read_slot_info(octets, at, slot_count)
    at = end
    info = Info(
        wire_version=wire_version,
        oldest_host_version=oldest_host_version,
        schema_hash=schema_hash,
        firmware_version=firmware_version,
        board=_member(Board, board),
        unique_id=unique_id,
        pitch_m=pitch_m,
        rate_hz=rate_hz,
        rate_max_hz=rate_max_hz,
        mode=Mode(mode),
        calibration_sequence=calibration_sequence,
        calibration_crc32=calibration_crc32,
        node_count=node_count,
        slots=slots,
    )
    return info, len(octets) - at


_ORIENT_FIXED = struct.Struct("<BIHB")


def _encode_orient(orient: Orient) -> bytes:
    node_count = _checked_count(len(orient.nodes), NODE_MAX, "Orient.nodes")
    pieces = [
        _ORIENT_FIXED.pack(
            PacketId.ORIENT,
            _checked_int(orient.t_us, 0, 4294967295, "Orient.t_us"),
            _checked_int(orient.sequence, 0, 65535, "Orient.sequence"),
            node_count,
        ),
        _write_node(orient.nodes, node_count, "Orient.nodes"),
    ]
    return b"".join(pieces)


def _decode_orient(octets: bytes) -> tuple[Orient, int]:
    at = 0
    (
        _,
        t_us,
        sequence,
        node_count,
    ) = _take_fixed(_ORIENT_FIXED, octets, at, "Orient")
    at += _ORIENT_FIXED.size
    end = _end_of_items(octets, at, node_count, NODE_MAX, _NODE.itemsize, "Orient")
    nodes = _read_node(octets, at, node_count)
    at = end
    orient = Orient(
        t_us=t_us,
        sequence=sequence,
        nodes=nodes,
    )
    return orient, len(octets) - at


_ORIENT_COMPACT_FIXED = struct.Struct("<BIHB")


def _encode_orient_compact(orient_compact: OrientCompact) -> bytes:
    node_count = _checked_count(len(orient_compact.nodes), NODE_MAX, "OrientCompact.nodes")
    pieces = [
        _ORIENT_COMPACT_FIXED.pack(
            PacketId.ORIENT_COMPACT,
            _checked_int(orient_compact.t_us, 0, 4294967295, "OrientCompact.t_us"),
            _checked_int(orient_compact.sequence, 0, 65535, "OrientCompact.sequence"),
            node_count,
        ),
        _write_node_compact(orient_compact.nodes, node_count, "OrientCompact.nodes"),
    ]
    return b"".join(pieces)


def _decode_orient_compact(octets: bytes) -> tuple[OrientCompact, int]:
    at = 0
    (
        _,
        t_us,
        sequence,
        node_count,
    ) = _take_fixed(_ORIENT_COMPACT_FIXED, octets, at, "OrientCompact")
    at += _ORIENT_COMPACT_FIXED.size
    end = _end_of_items(octets, at, node_count, NODE_MAX, _NODE_COMPACT.itemsize, "OrientCompact")
    nodes = _read_node_compact(octets, at, node_count)
    at = end
    orient_compact = OrientCompact(
        t_us=t_us,
        sequence=sequence,
        nodes=nodes,
    )
    return orient_compact, len(octets) - at


_RAW_FIXED = struct.Struct("<BIHBB")
_RAW_FIXED_3 = struct.Struct("<HHHHHH")


def _encode_raw(raw: Raw) -> bytes:
    accel_count = _checked_count(len(raw.accels), NODE_MAX, "Raw.accels")
    mag_count = _checked_count(len(raw.mags), NODE_MAX, "Raw.mags")
    pieces = [
        _RAW_FIXED.pack(
            PacketId.RAW,
            _checked_int(raw.t_us, 0, 4294967295, "Raw.t_us"),
            _checked_int(raw.sequence, 0, 65535, "Raw.sequence"),
            accel_count,
            mag_count,
        ),
        _write_accel_raw(raw.accels, accel_count, "Raw.accels"),
        _write_mag_raw(raw.mags, mag_count, "Raw.mags"),
        _RAW_FIXED_3.pack(
            _checked_int(raw.accel_age_us, 0, 65535, "Raw.accel_age_us"),
            _checked_int(raw.accel_period_us, 0, 65535, "Raw.accel_period_us"),
            _checked_int(raw.accel_span_us, 0, 65535, "Raw.accel_span_us"),
            _checked_int(raw.mag_age_us, 0, 65535, "Raw.mag_age_us"),
            _checked_int(raw.mag_period_us, 0, 65535, "Raw.mag_period_us"),
            _checked_int(raw.mag_span_us, 0, 65535, "Raw.mag_span_us"),
        ),
    ]
    return b"".join(pieces)


def _decode_raw(octets: bytes) -> tuple[Raw, int]:
    at = 0
    (
        _,
        t_us,
        sequence,
        accel_count,
        mag_count,
    ) = _take_fixed(_RAW_FIXED, octets, at, "Raw")
    at += _RAW_FIXED.size
    end = _end_of_items(octets, at, accel_count, NODE_MAX, _ACCEL_RAW.itemsize, "Raw")
    accels = _read_accel_raw(octets, at, accel_count)
    at = end
    end = _end_of_items(octets, at, mag_count, NODE_MAX, _MAG_RAW.itemsize, "Raw")
    mags = _read_mag_raw(octets, at, mag_count)
    at = end
    (
        accel_age_us,
        accel_period_us,
        accel_span_us,
        mag_age_us,
        mag_period_us,
        mag_span_us,
    ) = _take_fixed(_RAW_FIXED_3, octets, at, "Raw")
    at += _RAW_FIXED_3.size
    raw = Raw(
        t_us=t_us,
        sequence=sequence,
        accels=accels,
        mags=mags,
        accel_age_us=accel_age_us,
        accel_period_us=accel_period_us,
        accel_span_us=accel_span_us,
        mag_age_us=mag_age_us,
        mag_period_us=mag_period_us,
        mag_span_us=mag_span_us,
    )
    return raw, len(octets) - at


_STATUS_FIXED = struct.Struct("<BIIIIIIIIHHBBBhIIIB")
_STATUS_FIXED_2 = struct.Struct("<B")


def _encode_status(status: Status) -> bytes:
    slot_count = _checked_count(len(status.slots), SLOT_MAX, "Status.slots")
    health_count = _checked_count(len(status.health), SLOT_MAX, "Status.health")
    pieces = [
        _STATUS_FIXED.pack(
            PacketId.STATUS,
            _checked_int(status.t_us, 0, 4294967295, "Status.t_us"),
            _checked_int(status.uptime_s, 0, 4294967295, "Status.uptime_s"),
            _checked_int(status.scans, 0, 4294967295, "Status.scans"),
            _checked_int(status.overruns, 0, 4294967295, "Status.overruns"),
            _checked_int(status.frames_dropped, 0, 4294967295, "Status.frames_dropped"),
            _checked_int(status.rx_crc_errors, 0, 4294967295, "Status.rx_crc_errors"),
            _checked_int(status.rx_malformed, 0, 4294967295, "Status.rx_malformed"),
            _checked_int(status.rx_unknown, 0, 4294967295, "Status.rx_unknown"),
            _checked_int(status.scan_us, 0, 65535, "Status.scan_us"),
            _checked_int(status.rate_hz, 0, 65535, "Status.rate_hz"),
            _checked_int(status.mode, 0, 255, "Status.mode"),
            _checked_int(status.reset_cause, 0, 255, "Status.reset_cause"),
            _checked_int(status.clock_source, 0, 255, "Status.clock_source"),
            _scaled(status.temperature_c, 0.01, -32767, 32767, -32768),
            _checked_int(status.fault_pc, 0, 4294967295, "Status.fault_pc"),
            _checked_int(status.fault_lr, 0, 4294967295, "Status.fault_lr"),
            _checked_int(status.fault_cfsr, 0, 4294967295, "Status.fault_cfsr"),
            slot_count,
        ),
        _write_slot_status(status.slots, slot_count, "Status.slots"),
        _STATUS_FIXED_2.pack(
            health_count,
        ),
        _write_slot_health(status.health, health_count, "Status.health"),
    ]
    return b"".join(pieces)


def _decode_status(octets: bytes) -> tuple[Status, int]:
    at = 0
    (
        _,
        t_us,
        uptime_s,
        scans,
        overruns,
        frames_dropped,
        rx_crc_errors,
        rx_malformed,
        rx_unknown,
        scan_us,
        rate_hz,
        mode,
        reset_cause,
        clock_source,
        temperature_c,
        fault_pc,
        fault_lr,
        fault_cfsr,
        slot_count,
    ) = _take_fixed(_STATUS_FIXED, octets, at, "Status")
    at += _STATUS_FIXED.size
    end = _end_of_items(octets, at, slot_count, SLOT_MAX, _SLOT_STATUS.itemsize, "Status")
    slots = _read_slot_status(octets, at, slot_count)
    at = end
    (health_count,) = _take_fixed(_STATUS_FIXED_2, octets, at, "Status")
    at += _STATUS_FIXED_2.size
    end = _end_of_items(octets, at, health_count, SLOT_MAX, _SLOT_HEALTH.itemsize, "Status")
    health = _read_slot_health(octets, at, health_count)
    at = end
    status = Status(
        t_us=t_us,
        uptime_s=uptime_s,
        scans=scans,
        overruns=overruns,
        frames_dropped=frames_dropped,
        rx_crc_errors=rx_crc_errors,
        rx_malformed=rx_malformed,
        rx_unknown=rx_unknown,
        scan_us=scan_us,
        rate_hz=rate_hz,
        mode=Mode(mode),
        reset_cause=_member(ResetCause, reset_cause),
        clock_source=_member(ClockSource, clock_source),
        temperature_c=math.nan if temperature_c == -32768 else temperature_c * 0.01,
        fault_pc=fault_pc,
        fault_lr=fault_lr,
        fault_cfsr=fault_cfsr,
        slots=slots,
        health=health,
    )
    return status, len(octets) - at


_COMMAND_FIXED = struct.Struct("<BHBIB")


def _encode_command(command: Command) -> bytes:
    data_count = _checked_count(len(command.data), 192, "Command.data")
    pieces = [
        _COMMAND_FIXED.pack(
            PacketId.COMMAND,
            _checked_int(command.tag, 0, 65535, "Command.tag"),
            _checked_int(command.command, 0, 255, "Command.command"),
            _checked_int(command.argument, 0, 4294967295, "Command.argument"),
            data_count,
        ),
        _checked_bytes(command.data, 0, data_count, "Command.data"),
    ]
    return b"".join(pieces)


def _decode_command(octets: bytes) -> tuple[Command, int]:
    at = 0
    (
        _,
        tag,
        command,
        argument,
        data_count,
    ) = _take_fixed(_COMMAND_FIXED, octets, at, "Command")
    at += _COMMAND_FIXED.size
    end = _end_of_items(octets, at, data_count, 192, 1, "Command")
    data = bytes(octets[at:end])
    at = end
    command = Command(
        tag=tag,
        command=_member(CommandCode, command),
        argument=argument,
        data=data,
    )
    return command, len(octets) - at


_ACK_FIXED = struct.Struct("<BHBBIB")


def _encode_ack(ack: Ack) -> bytes:
    data_count = _checked_count(len(ack.data), 192, "Ack.data")
    pieces = [
        _ACK_FIXED.pack(
            PacketId.ACK,
            _checked_int(ack.tag, 0, 65535, "Ack.tag"),
            _checked_int(ack.command, 0, 255, "Ack.command"),
            _checked_int(ack.code, 0, 255, "Ack.code"),
            _checked_int(ack.value, 0, 4294967295, "Ack.value"),
            data_count,
        ),
        _checked_bytes(ack.data, 0, data_count, "Ack.data"),
    ]
    return b"".join(pieces)


def _decode_ack(octets: bytes) -> tuple[Ack, int]:
    at = 0
    (
        _,
        tag,
        command,
        code,
        value,
        data_count,
    ) = _take_fixed(_ACK_FIXED, octets, at, "Ack")
    at += _ACK_FIXED.size
    end = _end_of_items(octets, at, data_count, 192, 1, "Ack")
    data = bytes(octets[at:end])
    at = end
    ack = Ack(
        tag=tag,
        command=command,
        code=_member(AckCode, code),
        value=value,
        data=data,
    )
    return ack, len(octets) - at


_CLOCK_PING_FIXED = struct.Struct("<BHQ")


def _encode_clock_ping(clock_ping: ClockPing) -> bytes:
    pieces = [
        _CLOCK_PING_FIXED.pack(
            PacketId.CLOCK_PING,
            _checked_int(clock_ping.tag, 0, 65535, "ClockPing.tag"),
            _checked_int(clock_ping.t_host_us, 0, 18446744073709551615, "ClockPing.t_host_us"),
        ),
    ]
    return b"".join(pieces)


def _decode_clock_ping(octets: bytes) -> tuple[ClockPing, int]:
    at = 0
    (
        _,
        tag,
        t_host_us,
    ) = _take_fixed(_CLOCK_PING_FIXED, octets, at, "ClockPing")
    at += _CLOCK_PING_FIXED.size
    clock_ping = ClockPing(
        tag=tag,
        t_host_us=t_host_us,
    )
    return clock_ping, len(octets) - at


_CLOCK_PONG_FIXED = struct.Struct("<BHQII")


def _encode_clock_pong(clock_pong: ClockPong) -> bytes:
    pieces = [
        _CLOCK_PONG_FIXED.pack(
            PacketId.CLOCK_PONG,
            _checked_int(clock_pong.tag, 0, 65535, "ClockPong.tag"),
            _checked_int(clock_pong.t_host_us, 0, 18446744073709551615, "ClockPong.t_host_us"),
            _checked_int(clock_pong.t_receive_us, 0, 4294967295, "ClockPong.t_receive_us"),
            _checked_int(clock_pong.t_transmit_us, 0, 4294967295, "ClockPong.t_transmit_us"),
        ),
    ]
    return b"".join(pieces)


def _decode_clock_pong(octets: bytes) -> tuple[ClockPong, int]:
    at = 0
    (
        _,
        tag,
        t_host_us,
        t_receive_us,
        t_transmit_us,
    ) = _take_fixed(_CLOCK_PONG_FIXED, octets, at, "ClockPong")
    at += _CLOCK_PONG_FIXED.size
    clock_pong = ClockPong(
        tag=tag,
        t_host_us=t_host_us,
        t_receive_us=t_receive_us,
        t_transmit_us=t_transmit_us,
    )
    return clock_pong, len(octets) - at


_SIGMA_RAD = np.array(
    [
        0.000872664626,
        0.00138308023,
        0.00219203443,
        0.00347414045,
        0.00550614155,
        0.00872664626,
        0.0138308023,
        0.0219203443,
        0.0347414045,
        0.0550614155,
        0.0872664626,
        0.138308023,
        0.219203443,
        0.347414045,
        0.550614155,
        math.nan,
    ]
)
_ENCODERS: dict[type, Callable[[Any], bytes]] = {
    Info: _encode_info,
    Orient: _encode_orient,
    OrientCompact: _encode_orient_compact,
    Raw: _encode_raw,
    Status: _encode_status,
    Command: _encode_command,
    Ack: _encode_ack,
    ClockPing: _encode_clock_ping,
    ClockPong: _encode_clock_pong,
}
_DECODERS: dict[int, Callable[[bytes], tuple[Packet, int]]] = {
    PacketId.INFO: _decode_info,
    PacketId.ORIENT: _decode_orient,
    PacketId.ORIENT_COMPACT: _decode_orient_compact,
    PacketId.RAW: _decode_raw,
    PacketId.STATUS: _decode_status,
    PacketId.COMMAND: _decode_command,
    PacketId.ACK: _decode_ack,
    PacketId.CLOCK_PING: _decode_clock_ping,
    PacketId.CLOCK_PONG: _decode_clock_pong,
}
