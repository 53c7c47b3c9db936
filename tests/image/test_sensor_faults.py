"""Faults of the sensors on the image: found, named, bridged and recovered from, as a table."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from image.programs import built
from numpy.typing import NDArray
from ribbonhil.emulated_device import drawn_device
from ribbonhil.faults import BUS, Fault, FaultKind
from ribbonhil.scenes import BUILTIN
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.stm32f405.session import Session
from ribbonhil.truth import comb_truth
from ribbonhost.wire import Orient, SlotReason, decode

START_S, END_S = 1.0, 1.7
FOUND_WITHIN_S = 0.5
RECOVERED_WITHIN_S = 1.0
LOOKS_S = (0.03, 0.1, 0.2, 0.3, 0.4, 0.5)  # after the start
REACH_SLOTS = 4  # of the interpolation along the ribbon
FIRST, ACCELEROMETER, MAGNETOMETER, LAST = 0, 16, 15, 31

R = SlotReason
EXPECTED: dict[FaultKind, set[SlotReason]] = {
    FaultKind.ABSENT: {R.ABSENT},
    FaultKind.WRONG_ID: {R.WRONG_ID},
    FaultKind.STUCK: {R.STUCK},
    FaultKind.GARBAGE: {R.NOISY, R.OUT_OF_RANGE, R.WRONG_ID},
    FaultKind.STALE: {R.STALE},
    FaultKind.INTERMITTENT: {R.ABSENT, R.NOT_CONFIGURED},
    FaultKind.DRIFT: {R.OUT_OF_RANGE},
    FaultKind.BIT_FLIPS: {R.NOISY, R.OUT_OF_RANGE},
    FaultKind.BROWN_OUT: {R.ABSENT, R.NOT_CONFIGURED},
}


def parameter(kind: FaultKind, slot: int) -> float:
    """An unknown identity; half of the time; a fifth of g or a quarter of the field a second, on every
    axis; one bit in 50."""
    drift = 12.0 if slot % 2 else 2.0
    return {
        FaultKind.WRONG_ID: 0x5A,
        FaultKind.INTERMITTENT: 0.5,
        FaultKind.DRIFT: drift,
        FaultKind.BIT_FLIPS: 0.02,
    }.get(kind, 0.0)


@dataclass(frozen=True)
class Outcome:
    """found_s: when STATUS first named the slot, after the fault began; reason: the last named one.
    others: slots that were named besides. recovered: whether all were well again in time.
    error_deg: (16,) RMS error of each node in the last 0.2 s of the fault, NaN for one that was not valid.
    """

    found_s: float
    reason: SlotReason
    others: list[int]
    errors_counted: int
    recovered: bool
    error_deg: NDArray[np.float64]
    violation: str


def bad_slots(session: Session) -> dict[int, SlotReason]:
    return {i: SlotReason(reason) for i, reason in enumerate(session.current_status().slots.reason) if reason}


def live_through(kind: FaultKind | None, slot: int) -> Outcome:
    """A ribbon on the wing that has the fault from START_S to END_S."""
    truth = comb_truth(BUILTIN["wing"], 2)
    ribbon = ImageRibbon(read_elf(built()).image, truth.ribbon(1), drawn_device(3, 1))
    session = Session(ribbon)
    session.wait_for_info()
    clock_starts_s = ribbon.now_s - ribbon.device_us * 1e-6
    if kind is not None:
        ribbon.add_fault(Fault(kind, slot, START_S, END_S, parameter(kind, slot)))
    session.run_for(START_S - ribbon.now_s)
    assert bad_slots(session) == {}

    found_s, reason, others = np.inf, SlotReason.OK, set()
    for look_s in LOOKS_S:
        session.run_for(START_S + look_s - ribbon.now_s)
        bad = bad_slots(session)
        others |= bad.keys() - {slot}
        if slot in bad:
            found_s, reason = min(found_s, look_s), bad[slot]
    assert session.status is not None
    counted = int(session.status.slots.errors[slot % 32])
    session.run_for(END_S - ribbon.now_s)
    in_fault = [orient for packet in session.orients if isinstance(orient := decode(packet)[0], Orient)]
    t_s = np.array([orient.t_us * 1e-6 + clock_starts_s for orient in in_fault])
    wanted = t_s > END_S - 0.2
    q = np.stack([orient.nodes.q_world_node for orient in in_fault])[wanted]
    valid = np.stack([orient.nodes.valid for orient in in_fault])[wanted]
    q_truth = truth.q_world_slot(t_s[wanted])[:, 1, 1::2]
    cosine = np.minimum(np.abs(np.sum(q * q_truth, axis=-1)), 1.0)
    angle_deg = np.where(valid, np.degrees(2.0 * np.arccos(cosine)), np.nan)
    session.run_for(END_S + RECOVERED_WITHIN_S - ribbon.now_s)
    return Outcome(
        found_s=found_s,
        reason=reason,
        others=sorted(others),
        errors_counted=counted,
        recovered=not bad_slots(session),
        error_deg=np.sqrt(np.mean(angle_deg**2, axis=0)),
        violation=ribbon.mcu.violation,
    )


@cache
def without_fault() -> Outcome:
    return live_through(None, 0)


@pytest.mark.parametrize("slot", [FIRST, ACCELEROMETER, MAGNETOMETER, LAST])
@pytest.mark.parametrize("kind", list(EXPECTED), ids=lambda kind: kind.name.lower())
def test_fault_of_a_slot_is_found_named_bridged_and_over(kind: FaultKind, slot: int) -> None:
    healthy, outcome = without_fault(), live_through(kind, slot)
    far = np.abs(2 * np.arange(16) + 1 - slot) > REACH_SLOTS
    change_deg = outcome.error_deg - healthy.error_deg
    print(
        f"{kind.name.lower():13} slot {slot:2}: found after {outcome.found_s:.2f} s as "
        f"{outcome.reason.name.lower()}, {outcome.errors_counted} readings left out, error of nodes near it "
        f"{np.nanmax(change_deg[~far]):+.3f} deg, of others {np.nanmax(np.abs(change_deg[far])):.3f} deg"
    )
    assert outcome.found_s <= FOUND_WITHIN_S
    assert outcome.reason in EXPECTED[kind]
    assert outcome.errors_counted > healthy.errors_counted
    assert outcome.others == []
    assert np.all(np.abs(change_deg[far]) < 0.02)
    assert outcome.recovered
    assert outcome.violation == ""


@pytest.mark.parametrize(
    "kind", [FaultKind.MISO_LOW, FaultKind.MISO_HIGH], ids=lambda kind: kind.name.lower()
)
def test_data_line_stuck_is_every_slot_absent_until_it_is_over(kind: FaultKind) -> None:
    outcome = live_through(kind, BUS)
    assert outcome.others == list(range(32))
    assert np.all(np.isnan(outcome.error_deg))
    assert outcome.recovered
