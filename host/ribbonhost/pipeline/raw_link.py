"""Whether a link carries RAW beside ORIENT, told before it is asked to where that can be known, else by what
it drops."""

import math

from ribbonhost import wire
from ribbonhost.device import Device
from ribbonhost.framing import CRC_BYTES
from ribbonhost.motion.model import NODE_MAX, NODE_MIN

RAW_TIMED_VERSION = 2
"""The first wire version whose RAW says how old its readings are."""

LOAD_MAX = 0.9
"""Share of a link's speed that frames may take: the rest is for answers and clock pings."""

DROPPED_MAX = 0.05
"""Share of the frames of a second that may be dropped."""


def why_not(device: Device, rate_hz: int) -> str:
    """Why a device cannot send what its motion is estimated from; empty if, as far as is known, it can."""
    info = device.info
    assert info is not None  # a device that was opened has answered
    if info.wire_version < RAW_TIMED_VERSION:
        return (
            f"it speaks wire version {info.wire_version}, which does not tell how old readings are; "
            f"its motion is not estimated: flash a firmware of wire version {RAW_TIMED_VERSION} or later"
        )
    if not NODE_MIN <= info.node_count <= NODE_MAX:
        return (
            f"its motion is not estimated: that takes {NODE_MIN} to {NODE_MAX} nodes, "
            f"and it has {info.node_count}"
        )
    needed = load_bytes_per_s(info.node_count, len(info.slots), rate_hz)
    baud = device.link.baud
    if "://" not in device.name and needed > LOAD_MAX * baud / 10:  # for URLs a speed means nothing
        return (
            f"{baud} baud do not carry the {needed:.0f} bytes a second of RAW beside ORIENT at {rate_hz} Hz; "
            "its motion is not estimated: give a higher --baud if the ribbon has one, or a lower --rate"
        )
    return ""


def load_bytes_per_s(node_count: int, slot_count: int, rate_hz: int) -> float:
    """What ORIENT, RAW and STATUS take of a link, framed."""
    orient, raw, status = 8 + 7 * node_count, 21 + 17 * node_count, 56 + 5 * slot_count
    return rate_hz * (_frame_bytes(orient) + _frame_bytes(raw)) + _frame_bytes(status)


def _frame_bytes(packet_bytes: int) -> int:
    content = packet_bytes + CRC_BYTES
    return content + math.ceil(content / 254) + 1


class DropWatch:
    """Tells from the STATUS packets of a device whether its link is too slow."""

    def __init__(self) -> None:
        self._before: wire.Status | None = None

    def is_too_slow(self, status: wire.Status | None) -> bool:
        """Whether, since the status before, more frames were dropped than a good link drops."""
        before = self._before
        if status is None or status is before:
            return False
        self._before = status
        if before is None or status.uptime_s <= before.uptime_s:
            return False
        dropped = (status.frames_dropped - before.frames_dropped) % (1 << 32)
        return dropped > DROPPED_MAX * 2 * max(1, status.scans - before.scans)
