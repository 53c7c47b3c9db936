"""ORIENT, ORIENT_COMPACT and RAW: what follows each scan."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from ribbonhost.wire import Orient, OrientCompact, Raw

from ribbonhil.conformance.check import BrokenRuleError, Group, expect
from ribbonhil.conformance.checks.recordings import CLOCK_MODULUS, both, compact, rises
from ribbonhil.conformance.client import Frame
from ribbonhil.conformance.device import Device, Recording

GROUP = Group("stream")

SPACING_TOLERANCE_S = 0.0005
SPACING_TOLERANCE_RATIO = 0.02
SEQUENCE_MODULUS = 2**16
ScanKind = type[Orient] | type[OrientCompact] | type[Raw]
Scan = tuple[Frame, int, int]
# Type byte, t_us, sequence and node_count stand before the first node.
NODES_OFFSET = 8


def scans(recording: Recording, kind: ScanKind) -> list[Scan]:
    """(frame, sequence, t_us) of each packet of a kind. Raises BrokenRuleError if there are less than two."""
    found = [(f, int(p.sequence), int(p.t_us)) for f, p in recording.of(kind)]
    expect(len(found) >= 2, f"{kind.__name__} packets in mode {int(recording.mode)}", len(found))
    return found


def steps(found: list[Scan]) -> Iterator[tuple[Frame, int, float]]:
    """(frame, difference of sequence, difference of t_us) of neighbouring packets."""
    for (_, last, t_last_us), (frame, sequence, t_us) in pairwise(found):
        yield frame, (sequence - last) % SEQUENCE_MODULUS, (t_us - t_last_us) % CLOCK_MODULUS


def periods(step_us: float, rate_hz: int) -> int:
    """How many periods a step of t_us is, to the nearest; at least one."""
    return max(1, round(step_us * rate_hz / 1e6))


@GROUP.check("Link")
def sequence_counts_scans(device: Device) -> None:
    """sequence rises by one from scan to scan; what is missing was counted in frames_dropped."""
    recording = both(device)
    for kind in (Orient, Raw):
        missing = 0
        for frame, rise, _ in steps(scans(recording, kind)):
            expect(1 <= rise < SEQUENCE_MODULUS // 2, "sequence + 1", f"sequence + {rise}", frame)
            missing += rise - 1
        dropped = rises(recording, "frames_dropped")
        expect(missing <= dropped, f"at most {dropped} scans missing, as frames_dropped says", missing)


@GROUP.check("ORIENT")
def orient_and_raw_share_the_scan(device: Device) -> None:
    """ORIENT and RAW of one scan have the same sequence and t_us, and each scan has both."""
    recording = both(device)
    orients = {sequence: (frame, t_us) for frame, sequence, t_us in scans(recording, Orient)}
    raws = {sequence: (frame, t_us) for frame, sequence, t_us in scans(recording, Raw)}
    shared = orients.keys() & raws.keys()
    # One scan at each end may have been cut in two by the recording.
    alone = len(orients.keys() ^ raws.keys())
    expect(
        alone <= 2 + rises(recording, "frames_dropped"),
        f"ORIENT and RAW of each of {len(orients | raws)} scans",
        f"{alone} sequences in one of them only",
    )
    for sequence in shared:
        (orient, t_orient_us), (raw, t_raw_us) = orients[sequence], raws[sequence]
        expect(
            t_orient_us == t_raw_us,
            f"one t_us for sequence {sequence}",
            f"{t_orient_us} in ORIENT, {t_raw_us} in RAW",
            orient,
            raw,
        )


@GROUP.check("RAW")
def orient_comes_before_raw(device: Device) -> None:
    """ORIENT and RAW of one scan follow each other in this order."""
    seen: set[int] = set()
    for frame in both(device).frames:
        if isinstance(frame.packet, Orient):
            expect(frame.packet.sequence not in seen, "ORIENT before the RAW of its scan", "after it", frame)
        elif isinstance(frame.packet, Raw):
            seen.add(frame.packet.sequence)
    expect(bool(seen), "RAW packets", "none")


@GROUP.check("ORIENT")
def scans_are_evenly_spaced(device: Device) -> None:
    """t_us rises by 1/rate a scan, within 2 % or 0.5 ms; scans left out were counted in overruns."""
    recording = both(device)
    period_us = 1e6 / recording.rate_hz
    tolerance_us = max(SPACING_TOLERANCE_RATIO * period_us, SPACING_TOLERANCE_S * 1e6)
    left_out = 0
    for frame, rise, step_us in steps(scans(recording, Orient)):
        count = periods(step_us, recording.rate_hz)
        off_us = step_us - count * period_us
        expect(
            abs(off_us) <= tolerance_us,
            f"t_us a whole number of {period_us:g} us later, within {tolerance_us:g} us",
            f"{step_us} us later",
            frame,
        )
        left_out += count - rise
    overruns = rises(recording, "overruns")
    expect(left_out <= overruns, f"at most {overruns} scans left out, as overruns says", left_out)


@GROUP.check("ORIENT")
def node_count_is_as_info_says(device: Device) -> None:
    """ORIENT and ORIENT_COMPACT hold as many nodes as INFO says."""
    for recording, kind in ((both(device), Orient), (compact(device), OrientCompact)):
        scans(recording, kind)
        for frame in recording.frames:
            if not isinstance(frame.packet, Orient | OrientCompact):
                continue
            count = len(frame.packet.nodes)
            expect(count == device.info.node_count, f"{device.info.node_count} nodes", count, frame)


def words(frames: list[Frame], struct_bytes: int, word_bytes: int) -> npt.NDArray[np.uint64]:
    """The quaternion words of packets of nodes, (packets, nodes), as they were sent."""
    count = (len(frames[0].content) - NODES_OFFSET) // struct_bytes
    size = NODES_OFFSET + count * struct_bytes
    for frame in frames:
        expect(
            len(frame.content) >= size, f"{count} nodes in each packet", f"{len(frame.content)} bytes", frame
        )
    octets = np.frombuffer(b"".join(f.content[NODES_OFFSET:size] for f in frames), np.uint8)
    octets = octets.reshape(len(frames), count, struct_bytes)
    padded = np.zeros((len(frames), count, 8), np.uint8)
    padded[:, :, :word_bytes] = octets[:, :, :word_bytes]
    return padded.view("<u8")[:, :, 0]


def expect_smallest_three(
    frames: list[Frame], words: npt.NDArray[np.uint64], valid: npt.NDArray[np.bool_], bits: int
) -> None:
    """Raises BrokenRuleError unless valid words are unit quaternions without their largest component."""
    levels = (1 << (bits - 1)) - 1
    shifts = (2 + bits * np.arange(3)).astype(np.uint64)
    codes = (words[:, :, np.newaxis] >> shifts & np.uint64((1 << bits) - 1)).astype(np.int64)
    others = (codes - levels) / (levels * 2**0.5)
    squared = np.einsum("ijk,ijk->ij", others, others)
    largest = np.sqrt(np.maximum(0.0, 1.0 - squared))
    # Of four equal components, three rounded a whole code up leave the fourth four codes smaller.
    slack = 3.0 / levels
    for expected, good in (
        (f"codes of at most {2 * levels}", codes.max(axis=2) <= 2 * levels),
        ("components no longer than 1", squared <= 1.0),
        ("the component left out to be the largest", largest >= np.abs(others).max(axis=2) - slack),
    ):
        for packet, node in np.argwhere(valid & ~good)[:1]:
            seen = f"codes {codes[packet, node].tolist()}, squared length {squared[packet, node]:.4f}"
            raise BrokenRuleError(expected, f"{seen} in node {node}", frames[packet].coded)


@GROUP.check("Quaternions")
def orient_quaternions_are_unit(device: Device) -> None:
    """A valid node of ORIENT is a unit quaternion without its largest component; an invalid one is zeros."""
    frames = [frame for frame, _, _ in scans(both(device), Orient)]
    sent = words(frames, 7, 6)
    valid = (sent >> np.uint64(47)).astype(bool)
    for packet, node in np.argwhere(~valid & (sent != 0))[:1]:
        raise BrokenRuleError(
            "an invalid node of zeros", f"{sent[packet, node]:012x} in node {node}", frames[packet].coded
        )
    expect_smallest_three(frames, sent, valid, 15)


@GROUP.check("Quaternions")
def compact_quaternions_are_unit(device: Device) -> None:
    """A valid node of ORIENT_COMPACT is a unit quaternion without its largest component."""
    frames = [frame for frame, _, _ in scans(compact(device), OrientCompact)]
    sent = words(frames, 5, 4)
    expect_smallest_three(frames, sent, sent != 0xFFFFFFFF, 10)
