"""The bring-up probe under MicroPython's unix port, against the sensor models: what it finds and says."""

import re
import subprocess
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from ribbonhil._firmware import ffi, lib
from ribbonhil.emulated_device import PARTS, Device
from ribbonhil.faults import BUS, Fault, FaultKind
from ribbonhil.probe.build import build
from ribbonhil.probe.emulated import Outcome, Supply, at_rest, micropython, passed_by_a_magnet, run
from ribbonhil.truth import RibbonTruth

SLOTS = 8
ROW = re.compile(r"^ +(\d+)  (\S+) +([0-9a-f ]+?)  +(.*)$", re.MULTILINE)
LIS2DW12, MMC5983MA, HMC5983 = lib.WIRE_PART_LIS2DW12, lib.WIRE_PART_MMC5983MA, lib.WIRE_PART_HMC5983


@dataclass(frozen=True)
class Row:
    """A line of the table; noise: x, y, z and the data sheet's, none if there is none."""

    part: str
    identity: str
    noise: tuple[float, ...]
    verdict: str


def rows(outcome: Outcome) -> list[Row]:
    """The table, a row a slot in order."""
    found = []
    for slot, part, identity, rest in ROW.findall(outcome.text):
        assert int(slot) == len(found)
        noise = re.match(r"([\d.]+) +([\d.]+) +([\d.]+) +([\d.]+) (?:mm/s2|uT) +(.*)", rest)
        verdict = noise[5] if noise else rest.lstrip("- ")
        found.append(Row(part, identity, tuple(map(float, noise.groups()[:4])) if noise else (), verdict))
    return found


def sentences(outcome: Outcome) -> list[str]:
    """What is wrong, a sentence each."""
    return re.findall(r"^- (.*)$", outcome.text, re.MULTILINE)


def wrong(outcome: Outcome) -> dict[int, str]:
    """The verdict of each slot that is not ok."""
    return {slot: row.verdict for slot, row in enumerate(rows(outcome)) if row.verdict != "ok"}


def probe(*faults: Fault, parts: tuple[int, ...] = PARTS[:SLOTS], **how: object) -> Outcome:
    return run(Device(seed=5, parts=parts), faults=faults, **how)


@cache
def clean() -> Outcome:
    return run(Device(seed=5))


def test_clean_string_passes_with_a_row_a_slot():
    outcome = clean()
    assert outcome.status == 0
    assert [(row.part, row.identity, row.verdict) for row in rows(outcome)] == [
        ("LIS2DW12", "44", "ok"),
        ("MMC5983MA", "30", "ok"),
    ] * 16
    assert re.search(r"^PASS: 32 slots", outcome.text, re.MULTILINE)
    assert sentences(outcome) == []


@pytest.mark.parametrize("seed", range(3))
def test_no_two_parts_are_selected_at_once_whatever_the_flip_flops_held(seed: int):
    outcome = run(Device(seed=seed, parts=PARTS[:SLOTS]))
    assert outcome.status == 0
    assert outcome.counters.conflicts == 0


def test_noise_is_that_of_the_data_sheet():
    """64 readings know a standard deviation to 9 %; the mean over 16 parts and 3 axes to 1.3 %."""
    table = rows(clean())
    for kind, expected in ((0, 4.47), (1, 0.040)):
        noise = np.array([row.noise for row in table[kind::2]])
        assert noise[:, 3] == pytest.approx(expected, rel=0.01)
        assert noise[:, :3].mean() == pytest.approx(expected, rel=0.05)


def test_hmc5983_is_known_by_its_id_and_measured():
    outcome = probe(parts=(LIS2DW12, HMC5983, LIS2DW12, MMC5983MA))
    assert outcome.status == 0
    assert [(row.part, row.identity) for row in rows(outcome)[1::2]] == [
        ("HMC5983", "483433"),
        ("MMC5983MA", "30"),
    ]
    assert rows(outcome)[1].noise == pytest.approx((0.20,) * 4, rel=0.4)


@pytest.mark.parametrize("board", ["pyboard_v11", "feather_f405"])
def test_pins_are_those_of_the_board(board: str):
    """The emulated pins follow the board's schematic and refuse others."""
    outcome = probe(board=board)
    assert outcome.status == 0
    assert f"on a {board}" in outcome.text


ONE_SLOT = [
    (FaultKind.ABSENT, 3, 0.0, "silent", "Slot 3 did not answer"),
    (FaultKind.ABSENT, 7, 0.0, "silent", "Slot 7 did not answer"),
    (FaultKind.WRONG_ID, 4, 0x55, "unknown id", "Slot 4 answered with the id of no known part"),
    (FaultKind.WRONG_ID, 0, 0x00, "MISO low", "Slot 0 answered zeros only"),
    (FaultKind.GARBAGE, 6, 0.0, "garbage", "Slot 6 answered differently every time"),
    (FaultKind.BIT_FLIPS, 7, 0.01, "garbage", "Slot 7 answered differently every time"),
    (FaultKind.INTERMITTENT, 2, 0.3, "bad contact", "Slot 2 answered only at times"),
    (FaultKind.STUCK, 5, 0.0, "stuck", "Slot 5 gave the same counts over and over"),
    (FaultKind.STALE, 0, 0.0, "no readings", "Slot 0 gave no new readings"),
    (FaultKind.STALE, 3, 0.0, "no readings", "Slot 3 gave no new readings"),
]


@pytest.mark.parametrize(
    ("kind", "slot", "parameter", "verdict", "sentence"),
    ONE_SLOT,
    ids=[f"{case[0].name.lower()}-{case[1]}" for case in ONE_SLOT],
)
def test_fault_of_a_slot_is_named_and_no_other(
    kind: FaultKind, slot: int, parameter: float, verdict: str, sentence: str
):
    outcome = probe(Fault(kind, slot, parameter=parameter))
    assert outcome.status == 1
    assert wrong(outcome) == {slot: verdict}
    assert [said.startswith(sentence) for said in sentences(outcome)] == [True]


@pytest.mark.parametrize(("i", "j"), [(2, 4), (0, 6), (3, 7), (5, 6), (2, 7)])
def test_shorted_selects_are_told_whatever_the_parts_are(i: int, j: int):
    outcome = probe(Fault(FaultKind.SHORTED, i, parameter=j))
    assert outcome.status == 1
    assert wrong(outcome) == {i: f"shorted to {j}", j: f"shorted to {i}"}
    assert [
        said.startswith(f"The selects of slots {i} and {j} are shorted") for said in sentences(outcome)
    ] == [True]


def test_string_of_one_node_whose_selects_are_shorted_is_told():
    outcome = probe(Fault(FaultKind.SHORTED, 0, parameter=1), parts=PARTS[:2])
    assert wrong(outcome) == {0: "shorted to 1", 1: "shorted to 0"}


@pytest.mark.parametrize("parts", [(LIS2DW12, HMC5983) * 4, (LIS2DW12, MMC5983MA) * 4])
def test_shorted_magnetometers_of_either_make_are_told(parts: tuple[int, ...]):
    outcome = probe(Fault(FaultKind.SHORTED, 7, parameter=1), parts=parts)
    assert wrong(outcome) == {1: "shorted to 7", 7: "shorted to 1"}


@pytest.mark.parametrize(("i", "j"), [(5, 6), (1, 4)])
def test_crossed_selects_of_different_kinds_are_told_by_the_ids(i: int, j: int):
    outcome = probe(Fault(FaultKind.CROSSED, i, parameter=j))
    assert outcome.status == 1
    assert wrong(outcome) == {i: f"crossed with {j}", j: f"crossed with {i}"}
    assert [
        said.startswith(f"The selects of slots {i} and {j} are crossed") for said in sentences(outcome)
    ] == [True]


def test_selects_crossed_between_equal_parts_need_the_magnet():
    crossed = (Fault(FaultKind.CROSSED, 4, parameter=6), Fault(FaultKind.CROSSED, 7, parameter=3))
    without = probe(*crossed)
    assert without.status == 0
    assert "do not show so: make probe WALK=1" in without.text
    outcome = probe(*crossed, walk=True)
    assert outcome.status == 1
    assert [said[:41] for said in sentences(outcome)] == [
        "The selects of slots 4 and 6 are crossed:",
        "The selects of slots 3 and 7 are crossed:",
    ]


def test_three_exchanged_selects_are_told_in_their_order():
    outcome = probe(
        Fault(FaultKind.CROSSED, 2, parameter=4), Fault(FaultKind.CROSSED, 4, parameter=6), walk=True
    )
    assert outcome.status == 1
    assert len(sentences(outcome)) == 1
    assert (
        "slots 2, 4 and 6 sit, in this order, the parts that answer in slots 4, 6, 2" in sentences(outcome)[0]
    )


def test_string_in_order_passes_the_magnet():
    outcome = probe(walk=True)
    assert outcome.status == 0
    assert "Now push a magnetised screwdriver" in outcome.text


def test_magnet_from_the_wrong_end_and_slots_that_feel_nothing_are_told():
    truth = passed_by_a_magnet(SLOTS)
    reverse = RibbonTruth(
        np.ascontiguousarray(truth.specific_force_mps2[:, ::-1]),
        np.ascontiguousarray(truth.field_ut[:, ::-1]),
        truth.step_s,
        periodic=False,
    )
    assert all(
        "from the last slot to the first" in said for said in sentences(probe(truth=reverse, walk=True))
    )
    deaf = probe(truth=at_rest(2), walk=True, parts=(LIS2DW12, MMC5983MA))
    assert deaf.status == 1
    assert sentences(deaf) == ["Slots 0 and 1 did not feel the magnet: do it again, slower and nearer."]


@pytest.mark.parametrize("slots", [(4,), (7,), (3, 5)])
def test_select_that_is_always_low_is_found(slots: tuple[int, ...]):
    outcome = probe(*(Fault(FaultKind.SELECTED, slot) for slot in slots))
    assert outcome.status == 1
    verdicts = ["always selected" if slot in slots else "hidden" for slot in range(SLOTS)]
    assert [row.verdict for row in rows(outcome)] == verdicts
    assert len(sentences(outcome)) == 1


def test_selects_that_hide_each_other_are_still_told():
    outcome = probe(Fault(FaultKind.SELECTED, 4), Fault(FaultKind.SELECTED, 7))
    assert outcome.status == 1
    assert sentences(outcome)[0].startswith("One or more parts answer while no slot is selected")


@pytest.mark.parametrize(
    ("kind", "verdict", "start"),
    [
        (FaultKind.MISO_LOW, "MISO low", "MISO is low even against the pull-up"),
        (FaultKind.MISO_HIGH, "MISO high", "MISO is high even against the pull-down"),
    ],
)
def test_held_miso_is_told_once_and_not_as_many_silent_slots(kind: FaultKind, verdict: str, start: str):
    outcome = probe(Fault(kind, BUS))
    assert outcome.status == 1
    assert [row.verdict for row in rows(outcome)] == [verdict] * SLOTS
    assert [said.startswith(start) for said in sentences(outcome)] == [True]


def test_string_that_is_not_there_leaves_miso_free():
    outcome = probe(*(Fault(FaultKind.ABSENT, slot) for slot in range(SLOTS)))
    assert outcome.status == 1
    assert [said.startswith("No slot answers and MISO is free") for said in sentences(outcome)] == [True]


def test_broken_chain_is_told_by_where_the_silence_begins():
    outcome = probe(*(Fault(FaultKind.ABSENT, slot) for slot in (2, 5, 6, 7)))
    assert wrong(outcome) == dict.fromkeys((2, 5, 6, 7), "silent")
    broken, alone = sentences(outcome)
    assert "broken between flip-flops 4 and 5" in broken
    assert alone.startswith("Slot 2 did not answer")


def test_flip_flop_too_many_shifts_the_kinds_behind_it():
    shifted = (*PARTS[:3], lib.WIRE_PART_NONE, *PARTS[3:7])
    outcome = probe(parts=shifted)
    assert wrong(outcome) == {3: "silent", **dict.fromkeys(range(4, 8), "wrong kind")}
    assert any("too many or too few in front of slot 4" in said for said in sentences(outcome))


def test_part_of_the_other_kind_in_one_slot_is_told():
    outcome = probe(parts=(LIS2DW12, MMC5983MA, MMC5983MA, MMC5983MA))
    assert wrong(outcome) == {2: "wrong kind"}
    assert sentences(outcome) == ["In slot 2 answers: magnetometer; there belongs: accelerometer."]


def test_string_longer_than_expected_is_told():
    outcome = probe(parts=PARTS[: SLOTS + 2], slots=SLOTS)
    assert outcome.status == 1
    assert [said.startswith("A part answers behind slot 7") for said in sentences(outcome)] == [True]


def shaken(slots: list[int], sigma_mps2: float, sigma_ut: float) -> RibbonTruth:
    """A ribbon at rest, but in some slots everything trembles at random, anew every 5 ms."""
    random = np.random.default_rng(8)
    rest = at_rest(SLOTS)
    force = np.repeat(rest.specific_force_mps2, 600, axis=0)
    field = np.repeat(rest.field_ut, 600, axis=0)
    force[:, slots] += random.normal(0.0, sigma_mps2, (600, len(slots), 3))
    field[:, slots] += random.normal(0.0, sigma_ut, (600, len(slots), 3))
    return RibbonTruth(force, field, 0.005)


@pytest.mark.parametrize("slot", [4, 5])
def test_noisy_part_is_told_with_how_noisy_it_is(slot: int):
    outcome = probe(truth=shaken([slot], 0.030, 0.30))
    assert outcome.status == 1
    assert wrong(outcome) == {slot: "noisy"}
    assert sentences(outcome)[0].startswith(f"Slot {slot} had more than 2 times the noise")
    added = 30.0 if slot == 4 else 0.30
    assert rows(outcome)[slot].noise[:3] == pytest.approx((added,) * 3, rel=0.4)


def test_noise_of_all_parts_is_laid_to_what_they_share():
    outcome = probe(truth=shaken(list(range(SLOTS)), 0.050, 0.0))
    assert wrong(outcome) == dict.fromkeys(range(0, SLOTS, 2), "noisy")
    assert sentences(outcome)[0].startswith("Most accelerometers had more than 2 times the noise")


def supply_line(outcome: Outcome) -> tuple[float, float, float]:
    """Volts, and mV of ripple at rest and while scanned."""
    line = re.search(r"MCU: ([\d.]+) V, ripple \(RMS\) (\d+) mV at rest, (\d+) mV while", outcome.text)
    assert line
    return float(line[1]), float(line[2]), float(line[3])


def test_clean_supply_is_measured():
    assert supply_line(clean()) == (
        pytest.approx(3.3, abs=0.01),
        pytest.approx(0, abs=2),
        pytest.approx(0, abs=2),
    )


@pytest.mark.parametrize("ripple_hz", [50.0, 300.0, 2345.0])
def test_ripple_of_the_supply_is_measured_and_told(ripple_hz: float):
    outcome = probe(supply=Supply(ripple_v=0.1, ripple_hz=ripple_hz), parts=PARTS[:4])
    _, at_rest_mv, _ = supply_line(outcome)
    assert at_rest_mv == pytest.approx(100 / np.sqrt(2), rel=0.1)
    assert outcome.status == 1
    assert "mV RMS of ripple even at rest" in sentences(outcome)[0]


@pytest.mark.parametrize("mean_v", [2.9, 3.6])
def test_wrong_supply_is_told_with_its_voltage(mean_v: float):
    outcome = probe(supply=Supply(mean_v=mean_v), parts=PARTS[:4])
    assert outcome.status == 1
    assert sentences(outcome)[0].startswith(f"The supply is {mean_v:.2f} V")


def test_board_without_an_adc_on_the_reference_probes_all_the_rest():
    outcome = probe(supply=Supply(has_adc=False))
    assert outcome.status == 0
    assert "supply at the MCU: not measured, MicroPython on this board has no ADC" in outcome.text


def test_noise_free_string_is_not_mistaken_for_shorted_selects():
    """Equal counts that never change say nothing: the parts are stuck, not their selects."""
    outcome = run(Device(seed=5, parts=PARTS[:4], noise=0.0))
    assert {row.verdict for row in rows(outcome)} == {"stuck"}


def bursts(part: object) -> list[bytes]:
    """Random ones of a part; of the accelerometer's counts the two lowest bits are always 0."""
    random = np.random.default_rng(part.id)
    drawn = random.integers(0, 256, (200, part.burst_count), dtype=np.uint8)
    if part.id == LIS2DW12:
        drawn[:, 1::2] &= 0xFC
    return [row.tobytes() for row in drawn]


@pytest.mark.parametrize("index", range(lib.PART_COUNT))
def test_bursts_mean_what_the_firmware_says_they_do(index: int):
    part = lib.PARTS[index]
    asked = bursts(part)
    code = (
        "import hardware, parts\n"
        f"for burst in {[burst.hex() for burst in asked]!r}:\n"
        f"    print(*parts.decode(hardware.PARTS[{index}], bytes.fromhex(burst)))"
    )
    decoded = subprocess.run(
        [micropython(), "-c", code], cwd=build("pyboard_v11"), capture_output=True, text=True, check=True
    ).stdout.splitlines()
    sample = ffi.new("struct part_sample *")
    for burst, line in zip(asked, decoded, strict=True):
        lib.part_decode(part, burst, sample)
        assert line == f"{list(sample.counts)} {sample.is_new}"
