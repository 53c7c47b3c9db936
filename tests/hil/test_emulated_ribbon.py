"""A whole ribbon in virtual time: firmware, sensors, bus and link together."""

import numpy as np
import pytest
from ribbonhil.faults import BUS, Fault, FaultKind
from ribbonhil.ribbon import Device, EmulatedRibbon, drawn_device
from ribbonhil.scenes import BUILTIN
from ribbonhil.truth import RibbonTruth, comb_truth
from ribbonhost import wire
from ribbonhost.framing import Deframer, encode_frame
from scipy.spatial.transform import Rotation

STARTED_S = 0.5  # all sensors deliver by then


def packets(data: bytes) -> list[object]:
    deframer = Deframer()
    found = [wire.decode(packet)[0] for packet in deframer.feed(data)]
    assert (deframer.crc_errors, deframer.malformed) == (0, 0)
    return found


def orients(data: bytes) -> list[wire.Orient]:
    return [packet for packet in packets(data) if isinstance(packet, wire.Orient)]


def command(ribbon: EmulatedRibbon, code: wire.CommandCode, argument: int = 0) -> wire.Ack:
    """Sends a command now and lets 50 ms pass."""
    ribbon.read()
    ribbon.write(encode_frame(wire.encode(wire.Command(tag=5, command=code, argument=argument, data=b""))))
    ribbon.run_until(ribbon.now_s + 0.05)
    return next(packet for packet in packets(ribbon.read()) if isinstance(packet, wire.Ack))


def true_time_s(ribbon: EmulatedRibbon, t_us: int) -> float:
    """True time at which the device's clock shows t_us, in the first 71 minutes."""
    elapsed_us = (t_us - ribbon.device.clock_offset_us) % 2**32
    return elapsed_us * 1e-6 / (1 + ribbon.device.clock_ppm * 1e-6)


def angles_deg(ribbon: EmulatedRibbon, scene: str, index: int, seen: list[wire.Orient]) -> np.ndarray:
    """(scans, nodes) angle of each whole rotation from the truth."""
    t_s = np.array([true_time_s(ribbon, packet.t_us) for packet in seen])
    truth = comb_truth(BUILTIN[scene], 5).q_world_slot(t_s)[:, index, 1::2]
    q = np.array([packet.nodes.q_world_node for packet in seen])
    cosine = np.abs(np.einsum("tnk,tnk->tn", truth, q))
    return np.degrees(2 * np.arccos(np.minimum(cosine, 1)))


def test_same_arguments_give_the_same_bytes_however_time_is_divided():
    whole = EmulatedRibbon("wing", 1, seed=3)
    whole.run_until(1.5)
    expected = whole.read()
    steps = EmulatedRibbon("wing", 1, seed=3)
    got = bytearray()
    for t_s in np.sort(np.random.default_rng(0).uniform(0, 1.5, 700)):
        steps.run_until(float(t_s))
        got += steps.read()
    steps.run_until(1.5)
    assert bytes(got) + steps.read() == expected
    other = EmulatedRibbon("wing", 1, seed=4)
    other.run_until(1.5)
    assert other.read() != expected


@pytest.mark.parametrize("scene", ["wing", "breath"])
def test_orientations_are_those_of_the_truth_with_part_noise(scene: str):
    """Within 0.25 deg in the mean over all nodes and scans, and 2 deg always."""
    for index in (0, 3):
        ribbon = EmulatedRibbon(scene, index, seed=11)
        ribbon.run_until(6.0)
        seen = [p for p in orients(ribbon.read()) if true_time_s(ribbon, p.t_us) > 1.0]
        assert len(seen) >= 495
        assert all(packet.nodes.valid.all() for packet in seen)
        angle = angles_deg(ribbon, scene, index, seen)
        assert angle.mean() < 0.25
        assert angle.max() < 2.0


def test_scans_come_at_the_rate_of_the_devices_own_clock():
    ribbon = EmulatedRibbon("wing", 2, seed=5)
    ribbon.run_until(4.0)
    t_us = np.array([packet.t_us for packet in orients(ribbon.read())], dtype=np.uint32)
    assert np.abs(np.diff(t_us).astype(np.int64)[50:] - 10_000).max() < 400
    assert command(ribbon, wire.CommandCode.SET_RATE, 200).code == wire.AckCode.OK
    ribbon.run_until(6.0)
    assert len(orients(ribbon.read())) == pytest.approx(200 * (6.0 - 4.05), abs=3)


def test_normal_operation_has_no_conflict_and_asks_nothing_impossible():
    ribbon = EmulatedRibbon("wing", 0, seed=6)
    ribbon.run_until(STARTED_S)
    before = ribbon.counters()
    ribbon.run_until(5.0)
    counters = ribbon.counters()
    assert counters.conflicts == 0
    assert counters.rejected == before.rejected
    assert min(np.array(counters.samples) - before.samples) > 300


def test_a_device_does_not_wait_for_a_reader():
    silent, heard = EmulatedRibbon("wing", 0, seed=7), EmulatedRibbon("wing", 0, seed=7)
    silent.run_until(3.0)
    got = bytearray()
    for t_s in np.arange(0.01, 3.005, 0.01):
        heard.run_until(float(t_s))
        got += heard.read()
    assert silent.read() == bytes(got)


def test_slow_link_drops_whole_frames_and_counts_them():
    truth = comb_truth(BUILTIN["wing"], 5).ribbon(1)
    ribbon = EmulatedRibbon.from_truth(truth, drawn_device(1, 1, baud=38_400))
    ribbon.run_until(4.0)
    seen = packets(ribbon.read())
    sequence = np.array([packet.sequence for packet in seen if isinstance(packet, wire.Orient)])
    status = [packet for packet in seen if isinstance(packet, wire.Status)]
    assert np.diff(sequence).max() > 1
    assert status[-1].frames_dropped > 50
    assert len(sequence) < 150


@pytest.mark.parametrize("slot", [0, 1, 14, 31])
def test_absent_sensor_is_named_and_the_others_go_on(slot: int):
    ribbon = EmulatedRibbon("wing", 2, seed=8)
    ribbon.add_fault(Fault(FaultKind.ABSENT, slot, start_s=2.0, end_s=3.5))
    ribbon.run_until(1.9)
    ribbon.read()
    ribbon.run_until(3.4)
    during = packets(ribbon.read())
    status = [packet for packet in during if isinstance(packet, wire.Status)][-1]
    assert status.slots.reason[slot] != wire.SlotReason.OK
    assert (np.delete(status.slots.reason, slot) == wire.SlotReason.OK).all()
    ribbon.run_until(6.0)
    after = packets(ribbon.read())
    assert [p for p in after if isinstance(p, wire.Status)][-1].slots.reason[slot] == wire.SlotReason.OK
    assert [p for p in after if isinstance(p, wire.Orient)][-1].nodes.valid.all()


def test_stuck_miso_fails_all_slots_and_the_ribbon_recovers():
    ribbon = EmulatedRibbon("wing", 2, seed=9)
    ribbon.add_fault(Fault(FaultKind.MISO_LOW, BUS, start_s=1.5, end_s=3.5))
    ribbon.run_until(3.4)
    status = [p for p in packets(ribbon.read()) if isinstance(p, wire.Status)][-1]
    assert (status.slots.reason != wire.SlotReason.OK).all()
    ribbon.run_until(6.0)
    status = [p for p in packets(ribbon.read()) if isinstance(p, wire.Status)][-1]
    assert (status.slots.reason == wire.SlotReason.OK).all()


def test_clock_runs_by_its_error_from_its_offset():
    truth = comb_truth(BUILTIN["wing"], 5).ribbon(0)
    fast = EmulatedRibbon.from_truth(truth, Device(clock_ppm=1000.0, clock_offset_us=2**32 - 500_000))
    fast.run_until(2.0)
    assert fast.device_us == pytest.approx(2_000_000 * 1.001 - 500_000, abs=2)
    # Scans go on over the wrap of the clock.
    sequence = [packet.sequence for packet in orients(fast.read())]
    assert np.diff(sequence).tolist() == [1] * (len(sequence) - 1)


def test_recorded_truth_can_be_played_once():
    rows = 200
    turn = np.linspace(0, np.pi / 3, rows)
    r = Rotation.from_rotvec(np.outer(turn, [0, 0.6, 0.8]))
    force, field = r.inv().apply([0, 0, 9.80665]), r.inv().apply([0, 22.5, -42.4])
    every_slot = (rows, 32, 3)
    ribbon = EmulatedRibbon.from_truth(
        RibbonTruth(
            np.broadcast_to(force[:, None], every_slot),
            np.broadcast_to(field[:, None], every_slot),
            step_s=0.02,
            periodic=False,
        ),
        Device(),
    )
    ribbon.run_until(6.0)
    last = orients(ribbon.read())[-1]
    cosine = np.abs(last.nodes.q_world_node @ r[-1].as_quat()[[3, 0, 1, 2]])
    assert np.degrees(2 * np.arccos(np.minimum(cosine, 1))).max() < 1.0


def test_impossible_ribbons_and_faults_are_refused():
    truth = comb_truth(BUILTIN["wing"], 5).ribbon(0)
    with pytest.raises(ValueError, match="32 slots of truth do not fit 31 parts"):
        EmulatedRibbon.from_truth(truth, Device(parts=Device().parts[:31]))
    with pytest.raises(ValueError, match="no ribbon can be made"):
        EmulatedRibbon.from_truth(truth, Device(parts=(99,) * 32))
    ribbon = EmulatedRibbon.from_truth(truth, Device())
    with pytest.raises(ValueError, match="ends before it starts"):
        ribbon.add_fault(Fault(FaultKind.STUCK, 3, start_s=2.0, end_s=1.0))
