"""Whether a fault is noticed, named, kept apart and recovered from, in time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from ribbonhil.check.bench import Bench
from ribbonhil.check.check import Measurement, NotRunError, Topic, none_of
from ribbonhil.check.provoke import Provocation, Provoker
from ribbonhil.conformance.client import Frame
from ribbonhost.clock import extend_us
from ribbonhost.wire import Mode, Orient, Raw, SlotReason

TOPIC = Topic("fault_reaction")

NAMED_WITHIN_S = 0.5
RECOVERED_WITHIN_S = 1.0
PATIENCE_S = 4.0
"""How long is waited for the recovery: a late one is told with its time."""
SETTLE_S = 0.3
"""A wire that is pulled by hand bounces: what is wrong is asked for so long after it was noticed."""
STAYS_S = 0.2
"""What is well again must stay so."""
BEFORE_S = 0.5
"""Readings are looked at from so long before the fault: the last fresh one counts as its beginning."""

Reasons = NDArray[np.uint8]
Raws = list[tuple[Frame, Raw]]


def reasons_of(raw: Raw) -> Reasons:
    """(S,) of all slots."""
    reasons = np.zeros(len(raw.accels) + len(raw.mags), np.uint8)
    reasons[::2], reasons[1::2] = raw.accels.reason, raw.mags.reason
    return reasons


def ill(bench: Bench, raw: object) -> NDArray[np.bool_]:
    """(S,) whether a slot is named as faulty by a RAW packet."""
    assert isinstance(raw, Raw)
    return ~np.isin(reasons_of(raw), bench.well)


def counts_of(raw: Raw, slot: int) -> list[int]:
    """The three of one slot."""
    return [int(count) for count in (raw.mags if slot % 2 else raw.accels).counts[slot // 2]]


@TOPIC.check
def faults_are_noticed(bench: Bench) -> Iterator[Measurement]:
    """A fault is named in RAW and STATUS within 0.5 s, with the right slot and reason and no other slot;
    nodes beside one dead sensor stay valid, those of a dead string do not; and within 1 s of its end all is
    as before. An emulator injects it, or with --interactive you pull a wire."""
    if bench.provoker is None:
        raise NotRunError(
            "nothing here can make a fault: with --interactive you pull a wire when asked, and an emulated "
            "ribbon takes faults at an emulated:// URL or over --faults"
        )
    rate_hz = bench.readings.rate_hz
    slots = len(bench.info.slots)
    bench.device.set(rate_hz, Mode.ORIENT | Mode.RAW)
    for provocation in bench.provoker.provocations(slots):
        yield from react(bench, bench.provoker, provocation)


def react(bench: Bench, provoker: Provoker, provocation: Provocation) -> Iterator[Measurement]:
    """What the device does about one fault, from before it is made until it is over."""
    device, struck, what = bench.device, list(provocation.slots), provocation.what
    since = device.mark()
    device.receive(BEFORE_S)
    unwell = np.flatnonzero(np.any([ill(bench, raw) for _, raw in raws(bench, since)], axis=0))
    if len(unwell):
        raise NotRunError(f"slot {unwell[0]} is not used before any fault is made: see ids")
    valid_before = valid_nodes(bench, since)

    began_s = provoker.start(provocation)
    fault = device.mark()
    noticed = device.wait_for(
        lambda frame: is_raw(bench, frame) and bool(np.all(ill(bench, frame.packet)[struck])),
        fault,
        provoker.patience_s,
    )
    if noticed is None or not isinstance(noticed.packet, Raw):
        yield Measurement(f"{what}: named after", float("inf"), "s", high=NAMED_WITHIN_S)
        provoker.stop(provocation)
        return
    before = raws(bench, since)
    noticed_s = device_s(before)[[frame is noticed for frame, _ in before]][0]
    if began_s is None:
        # Somebody's hand: the device could not know before the first reading that was not new any more.
        began_device_s, remark = last_fresh_s(before, struck, noticed), "from the last new reading"
    else:
        began_device_s, remark = began_s - delay_s(before), "from its start"
    yield Measurement(
        f"{what}: named after", max(0.0, noticed_s - began_device_s), "s", high=NAMED_WITHIN_S, where=remark
    )
    device.receive(SETTLE_S)
    settled = reasons_of(raws(bench, fault)[-1][1])
    _, status = device.get_status()
    for told_by, told in (("RAW", settled), ("STATUS", np.asarray(status.slots.reason))):
        yield none_of(f"{what}: wrong reasons in {told_by}", wrong_reasons(told, provocation))

    ended_s = provoker.stop(provocation)
    device.receive(max(0.0, ended_s - device.now_s()))
    during = raws(bench, fault)
    others = np.setdiff1d(np.arange(len(bench.info.slots)), struck)
    hurt = np.flatnonzero(np.any([ill(bench, raw)[others] for _, raw in during], axis=0))
    yield none_of(f"{what}: other slots named", (f"slot {others[place]}" for place in hurt))
    wanted = 0 if len(struck) == len(bench.info.slots) else valid_before
    yield Measurement(f"{what}: valid nodes meanwhile", valid_nodes(bench, fault), low=wanted, high=wanted)

    over = device.mark()
    device.wait_for(
        lambda frame: is_raw(bench, frame) and not np.any(ill(bench, frame.packet)),
        over,
        PATIENCE_S,
    )
    device.receive(STAYS_S)
    frames = raws(bench, fault)
    recovered_s = well_again_s(bench, frames) - (ended_s - delay_s(frames))
    yield Measurement(
        f"{what}: well again after",
        max(0.0, recovered_s),
        "s",
        high=RECOVERED_WITHIN_S,
        where=provoker.end_remark,
    )


def is_raw(bench: Bench, frame: Frame) -> bool:
    """Whether it is a RAW packet of as many slots as INFO says."""
    raw = frame.packet
    return isinstance(raw, Raw) and len(raw.accels) + len(raw.mags) == len(bench.info.slots)


def raws(bench: Bench, since: int) -> Raws:
    """RAW packets that came since a place in the log. Raises NotRunError if there is none."""
    frames = [frame for frame in bench.device.log[since:] if is_raw(bench, frame)]
    found = [(frame, frame.packet) for frame in frames if isinstance(frame.packet, Raw)]
    if not found:
        raise NotRunError("no RAW packets came")
    return found


def device_s(frames: Raws) -> NDArray[np.float64]:
    """Device times of scans, going on where the clock wraps."""
    t_us = [frames[0][1].t_us]
    for _, raw in frames[1:]:
        t_us.append(extend_us(raw.t_us, t_us[-1]))
    return np.array(t_us) * 1e-6


def delay_s(frames: Raws) -> float:
    """What turns host times into device times: host less device time of the frame that came fastest."""
    return float(np.min(np.array([frame.t_host_s for frame, _ in frames]) - device_s(frames)))


def last_fresh_s(frames: Raws, struck: list[int], noticed: Frame) -> float:
    """Device time of the last scan before the fault was noticed in which a struck slot had a new reading."""
    last: dict[int, list[int]] = {}
    times_s = device_s(frames)
    fresh_s = float(times_s[0])
    for time_s, (frame, raw) in zip(times_s, frames, strict=True):
        reasons = reasons_of(raw)
        for slot in struck:
            counts = counts_of(raw, slot)
            if reasons[slot] == SlotReason.OK and counts != last.get(slot):
                fresh_s = float(time_s)
            last[slot] = counts
        if frame is noticed:
            break
    return fresh_s


def wrong_reasons(reasons: Reasons, provocation: Provocation) -> Iterator[str]:
    """What is said of struck slots that is not what is wrong with them."""
    for slot in provocation.slots:
        if slot >= len(reasons):
            yield f"slot {slot}: left out"
            continue
        reason = int(reasons[slot])
        if reason not in provocation.reasons:
            yield f"slot {slot}: {SlotReason(reason).name.lower() if reason in set(SlotReason) else reason}"


def valid_nodes(bench: Bench, since: int) -> int:
    """How many nodes were valid in the last ORIENT since a place in the log; -1 if none came."""
    orients = [frame.packet for frame in bench.device.log[since:] if isinstance(frame.packet, Orient)]
    return int(orients[-1].nodes.valid.sum()) if orients else -1


def well_again_s(bench: Bench, frames: Raws) -> float:
    """Device time of the scan from which on no slot is named any more; infinite if the last one still is."""
    unwell = np.array([bool(ill(bench, raw).any()) for _, raw in frames])
    if unwell[-1]:
        return float("inf")
    first_well = int(np.flatnonzero(unwell)[-1]) + 1 if unwell.any() else 0
    return float(device_s(frames)[first_well])
