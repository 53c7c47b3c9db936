"""The select chain, the bus and its faults, as the MCU's pins see them."""

import numpy as np
import pytest
from hil.string_bench import LIS2DW12, MMC5983MA, MS, S, StringBench
from ribbonhil._firmware import lib

WHO_AM_I, CTRL1, STATUS, OUT_X_L = 0x0F, 0x20, 0x27, 0x28
IDENTITY = {LIS2DW12: (0x0F, 0x44), MMC5983MA: (0x2F, 0x30)}


def string(slots: int = 6, **world: object) -> StringBench:
    """Accelerometers and magnetometers in turn, 25 ms after power-up."""
    bench = StringBench(*([LIS2DW12, MMC5983MA] * (slots // 2)), **world)
    bench.wait(0.025)
    return bench


def identity(bench: StringBench, slot: int) -> int:
    return bench.read(slot, IDENTITY[bench_part(slot)][0])[0]


def bench_part(slot: int) -> int:
    return MMC5983MA if slot % 2 else LIS2DW12


def start(bench: StringBench, slot: int) -> None:
    """Sets a sensor measuring: the accelerometer on its own at 100 Hz, the magnetometer at 100 Hz too."""
    if slot % 2:
        bench.write(slot, 0x0A, 0x01)
        bench.write(slot, 0x09, 0x08)
        bench.write(slot, 0x0B, 0x0D)
    else:
        bench.write(slot, 0x25, 0x04)
        bench.write(slot, CTRL1, 0x54)


def data(bench: StringBench, slot: int) -> bytes:
    return bench.read(slot, 0x00, 7) if slot % 2 else bench.read(slot, OUT_X_L, 6)


def fresh(bench: StringBench, slot: int) -> bool:
    """Whether a sample is ready; a magnetometer hides it while it takes the next, 4 ms."""
    for _ in range(10 if slot % 2 else 1):
        if bench.read(slot, 0x08 if slot % 2 else STATUS)[0] & 1:
            return True
        bench.wait(0.0005)
    return False


def test_a_single_zero_walks_along_the_chain_and_selects_one_sensor_at_a_time():
    bench = string()
    bench.select(None)
    seen = []
    bench.clock(False)
    for slot in range(6):
        address, _ = IDENTITY[bench_part(slot)]
        seen.append(bench.bytes(bytes([0x80 | address, 0]))[1])
        bench.clock(True)
    assert seen == [0x44, 0x30] * 3
    assert bench.bytes(b"\x8f\x00") == b"\xff\xff"
    assert bench.bus.counters.conflicts == 0


def test_flip_flops_hold_anything_after_power_up_and_the_same_for_a_seed():
    starts = [StringBench(*[LIS2DW12] * 32, seed=seed).bus.chain.selected for seed in range(16)]
    assert len(set(starts)) == 16
    assert starts == [StringBench(*[LIS2DW12] * 32, seed=seed).bus.chain.selected for seed in range(16)]
    assert 200 < sum(s.bit_count() for s in starts) < 312


def test_two_selected_sensors_are_a_conflict_with_its_time():
    bench = string()
    bench.select(None)
    bench.clock(False)
    bench.clock(True)
    bench.clock(False)  # slots 0 and 2
    before_ns = bench.t_ns
    bench.bytes(b"\x8f\x00")
    assert bench.bus.counters.conflicts == 2
    assert before_ns < bench.bus.counters.first_conflict_ns < bench.bus.counters.last_conflict_ns
    assert bench.bus.counters.last_conflict_ns == bench.t_ns


def test_colliding_answers_pull_each_other_low_and_both_take_what_is_written():
    bench = string()
    bench.select(None)
    for data_bit in (False, False, True):
        bench.clock(data_bit)  # slots 1 and 2
    assert bench.bytes(bytes([0x80 | 0x2F, 0]))[1] == 0x30 & 0x00
    bench.bytes(bytes(2))
    bench.select(None)
    assert bench.rejected(1) | bench.rejected(2)


def test_empty_slot_leaves_the_bus_pulled_up():
    bench = StringBench(LIS2DW12, lib.WIRE_PART_NONE, MMC5983MA)
    bench.wait(0.025)
    assert bench.read(1, WHO_AM_I, 4) == b"\xff" * 4


@pytest.mark.parametrize("slot", [0, 1, 5])
def test_absent_part_drives_nothing_and_comes_back_with_its_defaults(slot: int):
    bench = string()
    start(bench, slot)
    bench.fault("absent", slot, bench.t_ns, bench.t_ns + 100 * MS)
    bench.wait(0.05)
    assert identity(bench, slot) == 0xFF
    assert identity(bench, (slot + 1) % 6) in (0x44, 0x30)
    bench.wait(0.055)
    assert identity(bench, slot) == 0xFF  # starting up
    bench.wait(0.02)
    assert identity(bench, slot) == IDENTITY[bench_part(slot)][1]
    bench.wait(0.1)
    assert not fresh(bench, slot)


@pytest.mark.parametrize("slot", [0, 1])
def test_wrong_identity_reads_what_the_fault_says(slot: int):
    bench = string()
    bench.fault("wrong_id", slot, parameter=0x55)
    assert identity(bench, slot) == 0x55


@pytest.mark.parametrize("slot", [2, 3])
def test_stuck_part_delivers_fresh_samples_with_the_same_counts(slot: int):
    bench = string(noise=1.0)
    start(bench, slot)
    bench.wait(0.1)
    bench.fault("stuck", slot, bench.t_ns, bench.t_ns + S)
    before = data(bench, slot)
    seen, ready = set(), 0
    for _ in range(40):
        bench.wait(0.0131)
        ready += fresh(bench, slot)
        seen.add(data(bench, slot))
    assert ready >= 15
    assert seen == {before}
    bench.wait(1.0)
    assert data(bench, slot) not in seen


@pytest.mark.parametrize("slot", [2, 3])
def test_stale_part_delivers_no_sample_until_the_fault_ends(slot: int):
    bench = string(noise=1.0)
    start(bench, slot)
    bench.wait(0.1)
    bench.fault("stale", slot, bench.t_ns, bench.t_ns + S // 2)
    data(bench, slot)
    taken = bench.bus.sensors[slot].counters.samples
    for _ in range(30):
        bench.wait(0.012)
        data(bench, slot)
    assert bench.bus.sensors[slot].counters.samples == taken
    bench.wait(0.2)
    data(bench, slot)
    assert bench.bus.sensors[slot].counters.samples > taken


def test_garbage_is_on_every_byte_and_looks_random():
    bench = string()
    bench.fault("garbage", 2)
    values = bench.read(2, 0x00, 2000)
    assert len(set(values)) > 200
    assert identity(bench, 4) == 0x44


def test_intermittent_contact_is_lost_the_given_share_of_the_time():
    bench = string()
    bench.fault("intermittent", 2, parameter=0.3)
    lost = []
    for _ in range(1000):
        lost.append(identity(bench, 2) == 0xFF)
        bench.wait(0.02)
    assert np.mean(lost) == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize(("slot", "rate", "lsb"), [(2, 2.0, 0.244e-3 * 9.80665), (3, 10.0, 0.1)])
def test_drift_moves_all_axes_at_its_rate(slot: int, rate: float, lsb: float):
    bench = string()
    start(bench, slot)
    bench.wait(0.1)
    before = values(bench, slot)
    bench.fault("drift", slot, bench.t_ns, bench.t_ns + 10 * S, parameter=rate)
    bench.wait(1.0)
    np.testing.assert_allclose(values(bench, slot) - before, rate * np.ones(3), atol=0.03 * rate + 2 * lsb)


def values(bench: StringBench, slot: int) -> np.ndarray:
    """m/s^2, or uT with the bridge offset left in."""
    raw = data(bench, slot)
    if slot % 2 == 0:
        return np.frombuffer(raw, "<i2") / 4 * 0.244e-3 * 9.80665
    counts = [raw[2 * i] << 10 | raw[2 * i + 1] << 2 | raw[6] >> (6 - 2 * i) & 3 for i in range(3)]
    return np.array(counts) * 100 / 16384


def test_bit_flips_come_with_their_probability():
    bench = string()
    bench.fault("bit_flips", 2, parameter=0.01)
    bench.write(2, 0x21, 0x00)
    values = np.frombuffer(bench.read(2, WHO_AM_I, 4000), np.uint8)
    flips = np.unpackbits(values ^ 0x44).mean()
    assert flips == pytest.approx(0.01, abs=0.002)


@pytest.mark.parametrize("slot", [0, 5])
def test_brown_out_drops_the_configuration_and_the_part_lives_on(slot: int):
    bench = string()
    start(bench, slot)
    bench.wait(0.05)
    assert fresh(bench, slot)
    bench.fault("brown_out", slot, bench.t_ns, bench.t_ns + 1)
    bench.wait(0.05)
    assert identity(bench, slot) == IDENTITY[bench_part(slot)][1]
    bench.wait(0.05)
    assert not fresh(bench, slot)
    start(bench, slot)
    bench.wait(0.05)
    assert fresh(bench, slot)


def test_select_output_stuck_low_makes_every_other_transfer_a_conflict():
    bench = string()
    bench.fault("selected", 3, bench.t_ns, bench.t_ns + S)
    assert identity(bench, 3) == 0x30
    assert bench.bus.counters.conflicts == 0
    identity(bench, 0)
    assert bench.bus.counters.conflicts == 2
    bench.wait(1.0)
    identity(bench, 0)
    assert bench.bus.counters.conflicts == 2


def test_crossed_selects_lead_to_each_others_part_until_the_fault_ends():
    bench = string()
    bench.fault("crossed", 2, bench.t_ns, bench.t_ns + S, parameter=5)
    bench.write(2, 0x0A, 0x01)  # of the magnetometer
    assert bench.rejected(5) == {}
    assert [bench.read(slot, 0x0F)[0] for slot in (0, 4, 5)] == [0x44] * 3
    assert [bench.read(slot, 0x2F)[0] for slot in (1, 2, 3)] == [0x30] * 3
    bench.wait(1.0)
    assert [identity(bench, slot) for slot in (2, 5)] == [0x44, 0x30]
    assert bench.bus.counters.conflicts == 0


def test_shorted_selects_select_both_parts_at_either_place():
    bench = string()
    bench.fault("shorted", 2, bench.t_ns, bench.t_ns + S, parameter=4)
    bench.write(2, 0x23, 0x0F)
    assert bench.read(4, 0x23)[0] == 0x0F
    bench.write(4, 0x23, 0x30)
    assert bench.read(2, 0x23)[0] == 0x30
    assert bench.read(0, 0x23)[0] == 0x00
    assert bench.bus.counters.conflicts == 8
    bench.wait(1.0)
    bench.write(2, 0x23, 0x00)
    assert bench.read(4, 0x23)[0] == 0x30


@pytest.mark.parametrize("other", [6, -1, float("nan")])
@pytest.mark.parametrize("kind", ["crossed", "shorted"])
def test_select_that_touches_no_slot_changes_nothing(kind: str, other: float):
    bench = string()
    bench.fault(kind, 2, parameter=other)
    assert [identity(bench, slot) for slot in range(6)] == [0x44, 0x30] * 3
    assert bench.bus.counters.conflicts == 0


def test_miso_follows_the_pull_unless_it_is_held():
    bench = string()
    bench.fault("miso_low", lib.FAULT_BUS, 30 * MS, 60 * MS)
    bench.fault("miso_high", lib.FAULT_BUS, 60 * MS, 90 * MS)

    def levels() -> tuple[bool, bool]:
        up, down = (lib.sensor_bus_miso(bench.bus, bench.t_ns, pull) for pull in (True, False))
        return up, down

    assert levels() == (True, False)
    bench.wait(0.02)
    assert levels() == (False, False)
    bench.wait(0.03)
    assert levels() == (True, True)
    bench.wait(0.02)
    assert levels() == (True, False)


@pytest.mark.parametrize(("kind", "byte"), [("miso_low", 0x00), ("miso_high", 0xFF)])
def test_stuck_miso_reads_the_same_from_all_slots(kind: str, byte: int):
    bench = string()
    bench.fault(kind, lib.FAULT_BUS, 30 * MS, 60 * MS)
    assert identity(bench, 0) == 0x44
    bench.wait(0.01)
    assert [identity(bench, slot) for slot in range(6)] == [byte] * 6
    bench.wait(0.03)
    assert identity(bench, 1) == 0x30


def test_truth_between_rows_is_cubic_and_gap_free_over_the_end_of_a_period():
    t = np.arange(64) / 64
    force = np.stack([np.sin(2 * np.pi * t), np.cos(2 * np.pi * t), np.sin(4 * np.pi * t)], axis=1) * 5
    bench = StringBench(LIS2DW12, specific_force_mps2=force, step_s=1 / 64, periodic=True)
    for time_s in np.random.default_rng(3).uniform(0, 5, 500):
        phase = 2 * np.pi * time_s
        expected = 5 * np.array([np.sin(phase), np.cos(phase), np.sin(2 * phase)])
        np.testing.assert_allclose(bench.force_at(time_s), expected, atol=2e-4)


def test_finite_truth_holds_its_first_and_last_row():
    force = np.linspace(0, 9, 10)[:, None] * np.ones(3)
    bench = StringBench(LIS2DW12, specific_force_mps2=force, step_s=0.1)
    assert bench.force_at(0.0) == pytest.approx(0.0)
    assert bench.force_at(0.45) == pytest.approx(4.5)
    assert bench.force_at(0.9) == pytest.approx(9.0)
    assert bench.force_at(77.0) == pytest.approx(9.0)
