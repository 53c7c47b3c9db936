"""The checks of hil/checks pass on a sound ribbon, module or image, and each fails on one that is not."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest
from hil.virtual_link import ALL, VirtualLink, run_checks
from image.programs import built
from ribbonhil.check.bench import Options
from ribbonhil.check.runner import Outcome, Report
from ribbonhil.emulated_device import drawn_device
from ribbonhil.handling import HANDLINGS, Handling, Trouble
from ribbonhil.ribbon import EmulatedRibbon
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.world import world_truth
from ribbonhost import wire
from ribbonhost.wire import Info, Orient, Packet, Part, Raw, ResetCause, SlotReason, Status

REST = HANDLINGS["rest"]
STRAIGHT = Options(seconds=1.2, straight=True)


def module(handling: Handling = REST, **device: Any) -> EmulatedRibbon:
    """A ribbon at rest whose device has other properties than the drawn ones."""
    truth = world_truth(handling, 1)
    return EmulatedRibbon.from_truth(truth.ribbon(1), dataclasses.replace(drawn_device(3, 1), **device))


def outcomes(report: Report) -> dict[str, Outcome]:
    return {result.check.name: result.outcome for result in report.results}


def failed(report: Report) -> dict[str, str]:
    """What failed, and by which measurements."""
    return {
        result.check.name: f"{result.reason} "
        + "; ".join(f"{m.what} {m.value} {m.where}" for m in result.measurements if m.passed is False)
        for result in report.results
        if result.outcome is Outcome.FAILED
    }


def test_sound_module_passes_every_check() -> None:
    report = run_checks(VirtualLink(module()), options=STRAIGHT)
    assert failed(report) == {}
    assert set(outcomes(report).values()) == {Outcome.PASSED}
    assert report.passed


def test_sound_image_passes_every_check() -> None:
    truth = world_truth(REST, 1)
    ribbon = ImageRibbon(read_elf(built()).image, truth.ribbon(1), drawn_device(3, 1))
    report = run_checks(VirtualLink(ribbon), options=STRAIGHT)
    assert failed(report) == {}
    assert set(outcomes(report).values()) == {Outcome.PASSED}


def test_parts_off_the_shelf_pass_before_they_are_calibrated() -> None:
    ribbon = EmulatedRibbon("rest", 1, ribbons=1, seed=3, part_errors=7)
    report = run_checks(VirtualLink(ribbon))
    assert failed(report) == {}
    health = next(result for result in report.results if result.check.name == "health")
    assert "slots that need a calibration" in {m.what for m in health.measurements}


def test_parts_off_the_shelf_are_not_straight_before_they_are_calibrated() -> None:
    ribbon = EmulatedRibbon("rest", 1, ribbons=1, seed=3, part_errors=7)
    report = run_checks(VirtualLink(ribbon), "static_pose", options=STRAIGHT)
    assert set(failed(report)) == {"straight_edge"}


def test_ribbon_that_moves_is_told_to_lie_still_and_passes_the_rest() -> None:
    report = run_checks(VirtualLink(EmulatedRibbon("wing", 1, ribbons=2, seed=3)), inject=False)
    not_run = {r.check.topic: r.reason for r in report.results if r.outcome is Outcome.NOT_RUN}
    assert set(not_run) == {"noise", "static_pose", "fault_reaction"}
    assert "lay it still" in not_run["noise"]
    assert failed(report) == {}


def test_ribbon_on_a_slow_link_is_loaded_with_what_fits() -> None:
    link = VirtualLink(module(baud=115_200))
    report = run_checks(link, options=Options(seconds=1.2, baud=115_200))
    assert failed(report) == {}
    loads = [m.where for r in report.results if r.check.name == "link" for m in r.measurements if m.where]
    assert loads == ["OrientCompact at 100 Hz"]


# ------------------------------------------------------------ ribbons with something wrong

Alter = Callable[[Packet], Packet | None]


@dataclass(frozen=True)
class Defect:
    """A ribbon with one thing wrong, and the checks that must find it, and no other.

    device: other properties of the emulated device. handling: where it lies. alter: what becomes of packets.
    """

    checks: frozenset[str]
    says: str
    device: dict[str, Any] = field(default_factory=dict)
    handling: Handling = REST
    alter: Callable[[], Alter] | None = None


DEFECTS: dict[str, Defect] = {}


def finds(checks: str, says: str) -> Callable[[Callable[[], Alter]], Callable[[], Alter]]:
    """Decorator of a function that makes an Alter: registers it under its name."""

    def register(make: Callable[[], Alter]) -> Callable[[], Alter]:
        DEFECTS[make.__name__] = Defect(frozenset(checks.split()), says, alter=make)
        return make

    return register


def changed(kind: type[Packet], change: Callable[[Any], dict[str, Any]]) -> Alter:
    """Other fields in the packets of one kind."""

    def alter(packet: Packet) -> Packet:
        return dataclasses.replace(packet, **change(packet)) if isinstance(packet, kind) else packet

    return alter


DEFECTS |= {
    "clock_far_off": Defect(
        frozenset({"clock_of_the_device"}), "device clock fast by", {"clock_ppm": 2000.0}
    ),
    "noisy_supply": Defect(frozenset({"noise_of_each_axis"}), "times the data sheet, most", {"noise": 3.0}),
    "too_quiet": Defect(
        frozenset({"noise_of_each_axis", "new_samples"}), "times the data sheet, least", {"noise": 0.15}
    ),
    "bent": Defect(
        frozenset({"straight_edge"}),
        "turn between neighbours",
        handling=dataclasses.replace(REST, trouble=Trouble(bend_1pm=2.0)),
    ),
}


@finds("identity", "schema")
def another_schema() -> Alter:
    return changed(Info, lambda info: {"schema_hash": info.schema_hash ^ 1})


@finds("identity", "serial number")
def erased_serial_number() -> Alter:
    return changed(Info, lambda info: {"unique_id": b"\xff" * 12})


@finds("parts", "magnetometers missing or other 1 slot 31: none")
def missing_part() -> Alter:
    def change(info: Info) -> dict[str, Any]:
        part = info.slots.part.copy()
        part[31] = Part.NONE
        return {"slots": dataclasses.replace(info.slots, part=part)}

    return changed(Info, change)


@finds("health", "last start a crash watchdog")
def restarted_by_the_watchdog() -> Alter:
    return changed(Status, lambda status: {"reset_cause": ResetCause.WATCHDOG})


@finds("health", "clock internal_rc")
def crystal_that_did_not_start() -> Alter:
    return changed(Status, lambda status: {"clock_source": wire.ClockSource.INTERNAL_RC})


def timed(change: Callable[[int, int], int]) -> Alter:
    """Other times of scans: change(t_us, sequence)."""

    def alter(packet: Packet) -> Packet:
        if isinstance(packet, Orient | Raw):
            return dataclasses.replace(packet, t_us=change(packet.t_us, packet.sequence) % (1 << 32))
        return packet

    return alter


@finds("scans_a_second", "scans a second at 100 Hz 99.8")
def slow_timer() -> Alter:
    start: list[int] = []

    def change(t_us: int, sequence: int) -> int:
        start.append(t_us)
        return t_us + (t_us - start[0]) % (1 << 32) // 500

    return timed(change)


@finds("scan_intervals", "interval off by, p99 at 100 Hz")
def late_scans() -> Alter:
    return timed(lambda t_us, sequence: t_us + (1000 if sequence % 7 == 3 else 0))


@finds("link", "Raw missing in sequence")
def lost_frames() -> Alter:
    def alter(packet: Packet) -> Packet | None:
        return None if isinstance(packet, Raw) and packet.sequence % 50 == 0 else packet

    return alter


@finds("link", "frames to the device with a wrong CRC")
def noise_toward_the_device() -> Alter:
    return changed(Status, lambda status: {"rx_crc_errors": status.uptime_s})


@finds("overruns", "scans left out at 100 Hz")
def overrunning() -> Alter:
    return changed(Status, lambda status: {"overruns": status.uptime_s})


@finds("new_samples", "accelerometers: repeated, most")
def samples_that_come_twice() -> Alter:
    last: list[Any] = [None]

    def change(raw: Raw) -> dict[str, Any]:
        counts = raw.accels.counts.copy()
        if last[0] is not None and raw.sequence % 3 == 0:
            counts[3] = last[0]
        last[0] = counts[3].copy()
        return {"accels": dataclasses.replace(raw.accels, counts=counts)}

    return changed(Raw, change)


@finds("gravity_and_field", "|a| differs from g by")
def wrong_scale() -> Alter:
    def change(raw: Raw) -> dict[str, Any]:
        counts = raw.accels.counts.copy()
        counts[2] = np.round(1.2 * counts[2])
        return {"accels": dataclasses.replace(raw.accels, counts=counts)}

    return changed(Raw, change)


@finds("orientations", "within 3 sigma, least")
def sigma_too_small() -> Alter:
    random = np.random.default_rng(1)

    def change(orient: Orient) -> dict[str, Any]:
        q = orient.nodes.q_world_node + 0.02 * random.standard_normal(orient.nodes.q_world_node.shape)
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        return {"nodes": dataclasses.replace(orient.nodes, q_world_node=q)}

    return changed(Orient, change)


@finds("orientations", "nodes without sigma")
def sigma_not_told() -> Alter:
    def change(orient: Orient) -> dict[str, Any]:
        return {"nodes": dataclasses.replace(orient.nodes, quality=orient.nodes.quality | 15)}

    return changed(Orient, change)


def with_reasons(change: Callable[[np.ndarray, int], None]) -> Alter:
    """Other reasons of accelerometers in RAW: change(reasons, sequence) in place."""

    def fields(raw: Raw) -> dict[str, Any]:
        reasons = raw.accels.reason.copy()
        change(reasons, raw.sequence)
        return {"accels": dataclasses.replace(raw.accels, reason=reasons)}

    return changed(Raw, fields)


@finds("faults_are_noticed", "unpowered: named after inf")
def fault_not_named() -> Alter:
    def change(reasons: np.ndarray, sequence: int) -> None:
        reasons[8] = SlotReason.OK

    return with_reasons(change)


@finds("faults_are_noticed", "unpowered: other slots named 1 slot 18")
def neighbour_named_too() -> Alter:
    def change(reasons: np.ndarray, sequence: int) -> None:
        reasons[9] = reasons[8]

    return with_reasons(change)


@finds("faults_are_noticed", "unpowered: wrong reasons in RAW 1 slot 16: saturated")
def wrong_reason() -> Alter:
    def change(reasons: np.ndarray, sequence: int) -> None:
        reasons[8] = SlotReason.SATURATED if reasons[8] else SlotReason.OK

    return with_reasons(change)


@finds("faults_are_noticed", "unpowered: named after 0.6")
def named_late() -> Alter:
    ill_since: list[int] = []

    def change(reasons: np.ndarray, sequence: int) -> None:
        if reasons[8] == SlotReason.OK:
            ill_since.clear()
        else:
            ill_since.append(sequence)
            if (sequence - ill_since[0]) % (1 << 16) < 60:
                reasons[8] = SlotReason.OK

    return with_reasons(change)


@finds("faults_are_noticed", "well again after 1.")
def slow_to_recover() -> Alter:
    last_ill: list[int] = []

    def change(reasons: np.ndarray, sequence: int) -> None:
        if reasons[8] != SlotReason.OK:
            last_ill[:] = [sequence]
        elif last_ill and (sequence - last_ill[0]) % (1 << 16) < 130:
            reasons[8] = SlotReason.ABSENT

    return with_reasons(change)


@finds("faults_are_noticed", "wrong reasons in STATUS")
def status_that_knows_nothing() -> Alter:
    def change(status: Status) -> dict[str, Any]:
        return {"slots": dataclasses.replace(status.slots, reason=np.zeros_like(status.slots.reason))}

    return changed(Status, change)


@finds("faults_are_noticed", "MISO open: valid nodes meanwhile")
def orientations_without_readings() -> Alter:
    last: list[Any] = [None]

    def change(orient: Orient) -> dict[str, Any]:
        if orient.nodes.valid.all():
            last[0] = orient.nodes
        return {"nodes": last[0] or orient.nodes}

    return changed(Orient, change)


@pytest.mark.parametrize("name", DEFECTS)
def test_defect_is_found_by_its_check_and_no_other(name: str) -> None:
    defect = DEFECTS[name]
    alter = defect.alter() if defect.alter else None
    report = run_checks(VirtualLink(module(defect.handling, **defect.device), alter), options=STRAIGHT)
    found = failed(report)
    print(found)
    assert set(found) == defect.checks
    assert any(defect.says in text for text in found.values())
    assert not report.passed


def test_every_check_has_a_defect_that_it_finds() -> None:
    assert {name for defect in DEFECTS.values() for name in defect.checks} == {check.name for check in ALL}


@cache
def names() -> list[str]:
    return [check.name for check in ALL]


def test_names_are_unique_and_every_purpose_is_told() -> None:
    everything = names() + list({check.topic for check in ALL})
    assert len(set(everything)) == len(everything)
    assert all(check.purpose.endswith((".", "--straight.")) for check in ALL)
