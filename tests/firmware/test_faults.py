"""Faults of sensors and their bus: found in time, told with the right reason, bridged, and over when over.

pytest -s prints the table.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from firmware.running_ribbon import NODES, SLOTS, RunningRibbon, Seen
from ribbonhil.faults import BUS, Fault, FaultKind
from ribbonhil.scenes import load_scene
from ribbonhil.truth import comb_truth
from ribbonhost.wire import Raw, SlotReason

START_S, END_S, STOP_S = 1.0, 2.2, 3.4
FOUND_WITHIN_S, RECOVERED_WITHIN_S = 0.5, 1.0
COUNTS_PER_UT = 163.84  # of a MMC5983MA
ACCELEROMETER, MAGNETOMETER, FIRST, LAST = 10, 13, 0, SLOTS - 1

# Kind: its parameter for an accelerometer and a magnetometer, and what the slot may be told to be meanwhile.
FAULTS = {
    FaultKind.ABSENT: (0, 0, {SlotReason.ABSENT}),
    FaultKind.WRONG_ID: (0x33, 0x31, {SlotReason.WRONG_ID}),
    FaultKind.STUCK: (0, 0, {SlotReason.STUCK}),
    FaultKind.GARBAGE: (0, 0, {SlotReason.NOISY}),
    FaultKind.STALE: (0, 0, {SlotReason.STALE}),
    FaultKind.INTERMITTENT: (0.5, 0.5, {SlotReason.ABSENT}),
    FaultKind.DRIFT: (5.0, 40.0, {SlotReason.OUT_OF_RANGE}),
    FaultKind.BIT_FLIPS: (0.02, 0.02, {SlotReason.NOISY}),
    FaultKind.BROWN_OUT: (0, 0, {SlotReason.ABSENT, SlotReason.NOT_CONFIGURED}),
}


@cache
def healthy() -> Seen:
    return RunningRibbon().watch(STOP_S)


def test_healthy_ribbon_has_no_faults():
    seen = healthy()
    assert set(np.unique(seen.reasons)) == {SlotReason.OK}
    assert seen.statuses[-1].overruns == 0


def most_common(reasons: np.ndarray) -> SlotReason:
    wrong = reasons[reasons != SlotReason.OK]
    return SlotReason(int(np.bincount(wrong).argmax()))


def nodes_beyond(slot: int) -> np.ndarray:
    """Nodes whose orientation uses nothing of a slot: farther than any interpolation reaches."""
    return np.abs(2 * np.arange(NODES) + 1 - slot) > 8


@pytest.mark.parametrize("kind", FAULTS, ids=lambda kind: kind.name.lower())
def test_fault_of_a_slot_is_found_told_bridged_and_forgotten(kind):
    """Found within 0.5 s, recovered within 1 s; other slots stay ok, other nodes as good as without."""
    of_accelerometer, of_magnetometer, expected = FAULTS[kind]
    for slot in (ACCELEROMETER, MAGNETOMETER, FIRST, LAST):
        parameter = of_magnetometer if slot % 2 else of_accelerometer
        ribbon = RunningRibbon(faults=(Fault(kind, slot, START_S, END_S, parameter),))
        seen = ribbon.watch(STOP_S)
        of_slot = seen.reasons[:, slot]
        wrong_s = seen.t_raw_s[of_slot != SlotReason.OK]
        found_s = wrong_s[0] - START_S
        recovered_s = max(0.0, wrong_s[-1] - END_S)
        settled = (seen.t_raw_s > START_S + found_s) & (seen.t_raw_s < END_S)
        told = most_common(of_slot[settled])

        after = (seen.t_orient_s > START_S + FOUND_WITHIN_S) & (seen.t_orient_s < END_S)
        others = nodes_beyond(slot)
        extra_deg = np.abs(seen.error_deg[after] - healthy().error_deg[after])
        near_deg = seen.error_deg[after][:, ~others]
        print(
            f"{kind.name.lower():13s} slot {slot:2d}: {told.name.lower():15s} found {found_s:5.3f} s, "
            f"recovered {recovered_s:5.3f} s; error of nodes near {np.nanmean(near_deg):.2f} deg, of others "
            f"{extra_deg[:, others].mean():.4f} deg more"
        )
        assert 0 <= found_s <= FOUND_WITHIN_S
        assert recovered_s <= RECOVERED_WITHIN_S
        assert told in expected
        assert (np.delete(seen.reasons, slot, axis=1) == SlotReason.OK).all(), "no other slot is blamed"
        assert extra_deg[:, others].mean() < 0.01
        assert np.isfinite(near_deg).all(), "neighbours bridge it"
        assert np.mean(near_deg) < 0.5

        errors = seen.statuses[-1].slots.errors
        since_start = int((of_slot != SlotReason.OK).sum())
        assert errors[slot] - np.delete(errors, slot).max() == pytest.approx(since_start, abs=3)


@pytest.mark.parametrize("slot", range(SLOTS))
def test_slow_drift_is_found_on_every_slot(slot):
    """12 uT or 2 m/s^2 a second on every axis, far less than a bend of 7 cm radius makes in half a second."""
    drift = Fault(FaultKind.DRIFT, slot, START_S, END_S, 12.0 if slot % 2 else 2.0)
    seen = RunningRibbon(faults=(drift,)).watch(STOP_S)
    wrong_s = seen.t_raw_s[seen.reasons[:, slot] != SlotReason.OK]
    assert 0 <= wrong_s[0] - START_S <= FOUND_WITHIN_S
    assert wrong_s[-1] - END_S <= RECOVERED_WITHIN_S
    assert most_common(seen.reasons[:, slot]) == SlotReason.OUT_OF_RANGE
    assert (np.delete(seen.reasons, slot, axis=1) == SlotReason.OK).all(), "no other slot is blamed"


@pytest.mark.parametrize("slot", range(1, SLOTS, 6))
@pytest.mark.parametrize("wrong", [0.02, 0.05])
def test_offset_of_a_bridge_is_found_anew_after_noise(slot, wrong):
    """A second after it the readings are within 1 uT of those without the fault, with either polarity."""
    end_s = 2.1
    seen = RunningRibbon(faults=(Fault(FaultKind.BIT_FLIPS, slot, 1.4, end_s, wrong),)).watch(STOP_S)

    def counts(packets):
        return np.array([p.mags.counts[slot // 2] for p in packets if isinstance(p, Raw)])

    late = seen.t_raw_s > end_s + RECOVERED_WITHIN_S
    change_ut = (counts(seen.packets) - counts(healthy().packets))[late] / COUNTS_PER_UT
    assert np.abs(change_ut).max() < 1.0
    assert (seen.reasons[late] == SlotReason.OK).all()


@pytest.mark.parametrize(("scene", "period_s"), [("wing", 1.0), ("wing", 2.0), ("breath", 0.5)])
def test_fast_motion_is_no_fault(scene, period_s):
    """Up to 0.9 g at the tip."""
    truth = comb_truth(load_scene(scene, period_s), 3)
    for ribbon in range(4):
        raws = RunningRibbon(truth=truth.ribbon(ribbon)).run_until(3.0)
        reasons = [[*p.accels.reason, *p.mags.reason] for p in raws if isinstance(p, Raw)]
        assert set(np.unique(reasons[20:])) == {SlotReason.OK}


@pytest.mark.parametrize(
    "kind", [k for k in FAULTS if k != FaultKind.BROWN_OUT], ids=lambda k: k.name.lower()
)
def test_status_tells_slot_and_reason_while_a_fault_lasts(kind):
    of_accelerometer, _, expected = FAULTS[kind]
    ribbon = RunningRibbon(faults=(Fault(kind, ACCELEROMETER, 0.5, 9.0, of_accelerometer),))
    ribbon.run_until(0.5 + FOUND_WITHIN_S)
    told = [SlotReason(int(ribbon.status().slots.reason[ACCELEROMETER])) for _ in range(10)]
    assert most_common(np.array(told)) in expected
    reasons = ribbon.status().slots.reason
    assert (np.delete(reasons, ACCELEROMETER) == SlotReason.OK).all()


@pytest.mark.parametrize(
    "kind", [FaultKind.MISO_LOW, FaultKind.MISO_HIGH], ids=lambda kind: kind.name.lower()
)
def test_bus_that_is_stuck_makes_every_slot_absent_and_comes_back(kind):
    ribbon = RunningRibbon(faults=(Fault(kind, BUS, START_S, END_S),))
    seen = ribbon.watch(STOP_S)
    during = (seen.t_raw_s > START_S + 0.1) & (seen.t_raw_s < END_S)
    assert (seen.reasons[during] == SlotReason.ABSENT).all()
    last_wrong_s = seen.t_raw_s[(seen.reasons != SlotReason.OK).any(axis=1)][-1]
    print(f"{kind.name.lower():13s} whole bus: absent, recovered {last_wrong_s - END_S:.3f} s")
    assert last_wrong_s - END_S <= RECOVERED_WITHIN_S
    back = seen.t_orient_s > END_S + RECOVERED_WITHIN_S
    assert np.isfinite(seen.error_deg[back]).all()
    assert seen.error_deg[back].mean() < 0.3


def test_scans_go_on_while_slots_fail():
    """Half of all slots absent: no scan is left out, and the sequence has no gap."""
    faults = tuple(Fault(FaultKind.ABSENT, slot, 0.5) for slot in range(0, SLOTS, 4))
    ribbon = RunningRibbon(faults=faults)
    seen = ribbon.watch(2.5)
    assert np.diff(seen.t_raw_s) == pytest.approx(0.01, abs=3e-4)
    assert ribbon.status().overruns == 0
