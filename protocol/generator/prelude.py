"""What every codec needs whatever the schema says; generate.py copies it into wire.py."""

from __future__ import annotations

import math
import struct
from enum import IntEnum
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
