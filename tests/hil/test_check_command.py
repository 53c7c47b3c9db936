"""`ribbonhil check`: what it prints, writes and exits with; what was not run is no pass."""

from __future__ import annotations

import dataclasses
import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from hil.virtual_link import ALL, VirtualLink, run_checks
from ribbonhil.check.command import check
from ribbonhil.check.report import as_markdown
from ribbonhil.check.runner import Outcome
from ribbonhil.conformance import link as links
from ribbonhil.ribbon import EmulatedRibbon
from ribbonhost.errors import LinkError, LinkLostError, NoAnswerError, RibbonError, UsageError
from ribbonhost.wire import Board, ClockPong, Info, Mode, Orient, Packet, Raw, Status
from typer.testing import CliRunner, Result

URL = "socket://127.0.0.1:1"
A_PYBOARD = bytes.fromhex("2f0020000351343134383038")
SHORT = ("--seconds", "0.5")
ROOT = Path(__file__).resolve().parents[2]


def a_link(alter: Callable[[Packet], Packet | None] | None = None) -> VirtualLink:
    return VirtualLink(EmulatedRibbon("rest", 1, ribbons=1, seed=3), alter)


def changed(kind: type[Packet], **fields: Any) -> Callable[[Packet], Packet | None]:
    return lambda packet: dataclasses.replace(packet, **fields) if isinstance(packet, kind) else packet


def invoke(monkeypatch: pytest.MonkeyPatch, link: VirtualLink, *arguments: str) -> Result:
    """Runs the command on a link that stands for every port."""
    monkeypatch.setattr(links, "SerialLink", lambda url, baud: link)
    app = typer.Typer()
    app.command()(check)
    return CliRunner().invoke(app, arguments)


def test_table_says_what_it_ran_on_and_what_was_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    result = invoke(monkeypatch, a_link(), "--link", URL, *SHORT)
    assert result.exit_code == 0, result.stdout
    lines = result.stdout.splitlines()
    assert lines[0].startswith("Ran on: emulated module, firmware ")
    assert lines[0] == lines[-2]
    assert "scans a second at 200 Hz" in result.stdout
    assert "faults_are_noticed not run: nothing here can make a fault" in result.stdout
    assert lines[-1].endswith("12 passed, 0 failed, 2 not run")


@pytest.mark.parametrize(
    ("info", "kind"),
    [
        ({}, "emulated module"),
        ({"board": Board.PYBOARD_V11}, "emulated image"),
        ({"board": Board.PYBOARD_V11, "unique_id": A_PYBOARD}, "hardware"),
        ({"board": Board.PYBOARD_V11, "unique_id": bytes(range(12))}, "not known to be hardware"),
    ],
)
def test_report_names_what_it_ran_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, info: dict[str, Any], kind: str
) -> None:
    path = tmp_path / "report.json"
    arguments = ("--link", URL, "--only", "ids", "--json", "--report", str(path))
    result = invoke(monkeypatch, a_link(changed(Info, **info)), *arguments)
    report = json.loads(result.stdout)
    assert json.loads(path.read_text()) == report
    assert report["ran_on"]["kind"] == kind
    assert report["ran_on"]["is_hardware"] is (kind == "hardware")
    assert report["ran_on"]["link"] == URL
    assert len(report["ran_on"]["serial"]) == 24


def test_json_has_every_measurement_with_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    schema_off = changed(Info, schema_hash=1)
    result = invoke(monkeypatch, a_link(schema_off), "--link", URL, "--json", *SHORT)
    assert result.exit_code == 1
    report = json.loads(result.stdout)
    assert report["format"] == "ribbonhil check 1"
    assert report["passed"] is False
    assert [one["name"] for one in report["checks"]] == [one.name for one in ALL]
    by_name = {one["name"]: one for one in report["checks"]}
    assert by_name["identity"]["outcome"] == "failed"
    assert by_name["straight_edge"]["outcome"] == "not run"
    assert "--straight" in by_name["straight_edge"]["reason"]
    counted = {name: report["summary"][name] for name in ("passed", "failed", "not_run")}
    assert counted == {"passed": len(ALL) - 3, "failed": 1, "not_run": 2}
    for one in report["checks"]:
        assert one["purpose"]
        for measurement in one["measurements"]:
            assert set(measurement) == {
                "what", "value", "unit", "low", "high", "expected", "passed", "where",
            }  # fmt: skip
            judged = any(measurement[key] is not None for key in ("low", "high", "expected"))
            assert (measurement["passed"] is not None) is judged
    rate = by_name["scans_a_second"]["measurements"][0]
    assert (rate["unit"], rate["passed"]) == ("Hz", True)
    assert rate["low"] < rate["value"] < rate["high"]


def test_run_in_which_nothing_ran_is_no_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    result = invoke(monkeypatch, a_link(), "--link", URL, "--only", "fault_reaction", *SHORT)
    assert result.exit_code == 1
    assert "0 passed, 0 failed, 1 not run" in result.stdout


def test_only_takes_checks_and_topics(monkeypatch: pytest.MonkeyPatch) -> None:
    result = invoke(monkeypatch, a_link(), "--link", URL, "--only", "jitter", "--only", "parts", *SHORT)
    assert "2 checks in" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "Which ribbon?"),
        (("--link", URL, "--only", "nothing"), "no check or topic 'nothing'"),
        (("--link", URL, "--rates", "0,100"), "--rates 0,100 must be"),
        (("--link", URL, "--rates", "fast"), "--rates fast must be"),
        (("--link", URL, "--interactive"), "needs a terminal"),
        (("--link", URL, "--faults", "nowhere"), "HOST:PORT"),
        (("--link", "emulated://rest/99"), "after the scene comes a ribbon"),
        (("--link", URL, "--report", __file__), "--force replaces it"),
    ],
)
def test_wrong_usage_is_told(monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], says: str) -> None:
    error = invoke(monkeypatch, a_link(), *arguments).exception
    assert isinstance(error, UsageError)
    assert says in str(error)


def test_port_that_is_not_there_is_one_sentence() -> None:
    program = [sys.executable, "-m", "ribbonhil", "check", "--link", "/dev/no_such_port"]
    result = subprocess.run(program, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert result.stdout == ""
    assert len(result.stderr.strip().splitlines()) == 1
    assert "cannot open /dev/no_such_port: there is no such port" in result.stderr


def test_nobody_who_takes_faults_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    error = invoke(monkeypatch, a_link(), "--link", URL, "--faults", "127.0.0.1:1").exception
    assert isinstance(error, LinkError)
    assert "nobody takes faults at 127.0.0.1:1" in str(error)


def test_device_that_does_not_answer_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    error = invoke(monkeypatch, a_link(lambda packet: None), "--link", URL).exception
    assert isinstance(error, NoAnswerError)


def test_report_that_cannot_be_written_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "none" / "report.json"
    arguments = ("--link", URL, "--only", "parts", "--report", str(path))
    error = invoke(monkeypatch, a_link(), *arguments).exception
    assert isinstance(error, RibbonError)
    assert "cannot be written" in str(error)


class Interrupted(VirtualLink):
    """After three seconds something happens."""

    error: BaseException = KeyboardInterrupt()

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        if self.now_s() > 3.0 and self.error is not None:
            error, self.error = self.error, None  # type: ignore[assignment]
            raise error
        return super().read(timeout_s)


def test_ctrl_c_leaves_a_report_that_says_what_was_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    ribbon = EmulatedRibbon("rest", 1, ribbons=1, seed=3)
    result = invoke(monkeypatch, Interrupted(ribbon), "--link", URL, "--json", "--seconds", "2")
    report = json.loads(result.stdout)
    assert result.exit_code == 1
    assert report["summary"]["stopped"] == "stopped by Ctrl-C"
    assert report["summary"]["left_changed"] == ""
    outcomes = [one["outcome"] for one in report["checks"]]
    assert outcomes[:3] == ["passed"] * 3
    assert set(outcomes[3:]) == {"not run"}


class LosesItsLink(Interrupted):
    """The cable is pulled."""

    error = LinkLostError("/dev/ttyACM0 vanished")


def test_link_that_breaks_fails_the_check_and_ends_the_run() -> None:
    report = run_checks(LosesItsLink(EmulatedRibbon("rest", 1, ribbons=1, seed=3)))
    outcomes = [result.outcome for result in report.results]
    assert outcomes.count(Outcome.FAILED) == 1
    assert report.stopped == "/dev/ttyACM0 vanished"
    assert set(outcomes[outcomes.index(Outcome.FAILED) + 1 :]) == {Outcome.NOT_RUN}
    assert not report.passed


def test_rate_and_mode_are_afterwards_as_before() -> None:
    link = a_link()
    report = run_checks(link, "ids", "rate")
    assert report.left_changed == ""
    again = run_checks(link, "ids")
    assert (
        (again.info.rate_hz, again.info.mode) == (report.info.rate_hz, report.info.mode) == (100, Mode.ORIENT)
    )


def without(*kinds: type[Packet]) -> Callable[[Packet], Packet | None]:
    return lambda packet: None if isinstance(packet, kinds) else packet


def of_no_slots(packet: Packet) -> Packet:
    if not isinstance(packet, Info):
        return packet
    empty = dataclasses.replace(
        packet.slots, part=packet.slots.part[:0], axes=packet.slots.axes[:0], lsb=packet.slots.lsb[:0]
    )
    return dataclasses.replace(packet, slots=empty, node_count=0)


def of_lsb(lsb: float) -> Callable[[Packet], Packet]:
    def alter(packet: Packet) -> Packet:
        if not isinstance(packet, Info):
            return packet
        slots = dataclasses.replace(packet.slots, lsb=np.full(len(packet.slots), lsb))
        return dataclasses.replace(packet, slots=slots)

    return alter


def without_orientations(packet: Packet) -> Packet:
    if not isinstance(packet, Orient):
        return packet
    nodes = dataclasses.replace(packet.nodes, valid=np.zeros_like(packet.nodes.valid))
    return dataclasses.replace(packet, nodes=nodes)


def without_readings(packet: Packet) -> Packet:
    if not isinstance(packet, Raw):
        return packet
    accels = dataclasses.replace(packet.accels, reason=np.ones_like(packet.accels.reason))
    mags = dataclasses.replace(packet.mags, reason=np.ones_like(packet.mags.reason))
    return dataclasses.replace(packet, accels=accels, mags=mags)


def with_a_slot_less(packet: Packet) -> Packet:
    if not isinstance(packet, Raw):
        return packet
    accels = dataclasses.replace(
        packet.accels, reason=packet.accels.reason[1:], counts=packet.accels.counts[1:]
    )
    return dataclasses.replace(packet, accels=accels)


def with_a_slot_less_in_status(packet: Packet) -> Packet:
    if not isinstance(packet, Status):
        return packet
    slots = dataclasses.replace(packet.slots, reason=packet.slots.reason[:9], errors=packet.slots.errors[:9])
    return dataclasses.replace(packet, slots=slots)


ODD = {
    "no RAW": without(Raw),
    "no ORIENT": without(Orient),
    "no scans": without(Raw, Orient),
    "no pongs": without(ClockPong),
    "no slots": of_no_slots,
    "lsb 0": of_lsb(0.0),
    "lsb 1e30": of_lsb(1e30),
    "no orientations": without_orientations,
    "no readings": without_readings,
    "a slot less in RAW": with_a_slot_less,
    "fewer slots in STATUS": with_a_slot_less_in_status,
    "one scan a second": changed(Info, rate_max_hz=1),
}


@pytest.mark.parametrize("alter", ODD.values(), ids=ODD.keys())
def test_whatever_a_device_sends_is_judged(alter: Callable[[Packet], Packet | None]) -> None:
    report = run_checks(a_link(alter))
    assert len(report.results) == len(ALL)
    assert all(result.reason for result in report.results if result.outcome is Outcome.NOT_RUN)
    assert report.count(Outcome.PASSED) < len(ALL) - 1


def test_list_is_what_the_documentation_has() -> None:
    page = (ROOT / "docs/checks.md").read_text()
    assert page.partition("## Checks\n\n")[2] == as_markdown(ALL), (
        "put the output of `ribbonhil check --list` below ## Checks"
    )


# ------------------------------------------------------------ in real time, over ports of other programs


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[str, str]]:
    """URL of a ribbon, and where its faults are taken, of a running `ribbonhil serve`."""
    program = [sys.executable, "-m", "ribbonhil", "serve", "rest", "--ribbons", "2", "--tcp", "--port", "0"]
    program += ["--faults", "0", "--comb", str(tmp_path / "comb.toml")]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        try:
            assert process.stdout is not None
            lines = [process.stdout.readline() for _ in range(4)]
            yield lines[1].split()[-1], lines[3].split()[-1]
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(20)


def test_served_ribbon_reacts_to_faults(served: tuple[str, str]) -> None:
    url, faults = served
    program = [sys.executable, "-m", "ribbonhil", "check", "--link", url, "--faults", faults, "--json"]
    program += ["--only", "fault_reaction", "--only", "ids", "--seconds", "0.5"]
    result = subprocess.run(program, capture_output=True, text=True, check=False, timeout=120)
    report = json.loads(result.stdout)
    print(result.stdout)
    assert report["ran_on"]["kind"] == "emulated module"
    assert {one["name"]: one["outcome"] for one in report["checks"]}["faults_are_noticed"] == "passed"
    assert result.returncode == 0
