"""`ribbonhil conformance`: what it prints, and with which exit code it ends."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import typer
from conformance.breakers_info import InfoWithACounter
from conformance.responder import Responder
from conformance.test_runs import FlashOfOneWrite
from ribbonhil.conformance import link
from ribbonhil.conformance.checks import GROUPS, all_checks
from ribbonhil.conformance.command import conformance
from ribbonhil.conformance.report import as_markdown
from ribbonhost.errors import LinkError, UsageError
from typer.testing import CliRunner, Result

ROOT = Path(__file__).resolve().parents[2]
URL = "socket://127.0.0.1:1"


def invoke(monkeypatch: pytest.MonkeyPatch, responder: type[Responder], *arguments: str) -> Result:
    """Runs the command against a responder that stands for every port."""
    monkeypatch.setattr(link, "SerialLink", lambda url, baud: responder())
    monkeypatch.setenv("COLUMNS", "200")
    app = typer.Typer()
    app.command()(conformance)
    return CliRunner().invoke(app, arguments)


def test_a_right_device_gives_a_table_and_0(monkeypatch: pytest.MonkeyPatch) -> None:
    result = invoke(monkeypatch, Responder, URL, "--only", "info", "--only", "garbage_is_survived")
    assert result.exit_code == 0
    assert "unique_id_is_unique" in result.stdout
    assert "garbage_is_survived" in result.stdout
    assert "frames_are_cobs_with_crc" not in result.stdout
    assert "Ran on: emulated module, firmware 1.2.3, serial number 000102030405060708090a0b" in result.stdout


def test_a_broken_rule_is_told_with_bytes_and_clause_and_1(monkeypatch: pytest.MonkeyPatch) -> None:
    result = invoke(monkeypatch, InfoWithACounter, URL, "--only", "info_repeats")
    assert result.exit_code == 1
    for part in (
        "rule      INFO says the same each time",
        "expected  two equal INFO packets",
        r"seen      firmware_version b'\x01\x02",
        "bytes     0",
        "clause    protocol/PROTOCOL.md, INFO",
        "1 checks",
        "1 failed",
    ):
        assert part in result.stdout


def test_json_holds_every_result(monkeypatch: pytest.MonkeyPatch) -> None:
    result = invoke(monkeypatch, InfoWithACounter, URL, "--only", "info", "--json")
    report = json.loads(result.stdout)
    assert result.exit_code == 1
    assert (report["kind"], report["emulated"]) == ("emulated module", True)
    assert report["device"]["serial"] == "000102030405060708090a0b"
    outcomes = {check["name"]: check["outcome"] for check in report["checks"]}
    assert outcomes.keys() == {check.name for check in all_checks() if check.group == "info"}
    assert outcomes["info_repeats"] == "failed"
    assert report["summary"]["failed"] == 1
    assert report["summary"]["passed"] == len(outcomes) - 1
    assert report["summary"]["passed_all"] is False
    failed = next(check for check in report["checks"] if check["outcome"] == "failed")
    assert bytes.fromhex(failed["bytes"]).endswith(b"\0")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [((URL, "--only", "no_such_check"), "no check or group 'no_such_check'"), ((), "Which device?")],
)
def test_wrong_usage_is_told(monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], says: str) -> None:
    error = invoke(monkeypatch, Responder, *arguments).exception
    assert isinstance(error, UsageError)
    assert says in str(error)


def test_a_port_that_is_not_there_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    app = typer.Typer()
    app.command()(conformance)
    error = CliRunner().invoke(app, ["/dev/no_such_port"]).exception
    assert isinstance(error, LinkError)
    assert "/dev/no_such_port" in str(error)


def test_dfu_runs_only_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    without = json.loads(invoke(monkeypatch, Responder, URL, "--only", "dfu", "--json").stdout)
    with_dfu = json.loads(invoke(monkeypatch, Responder, URL, "--only", "dfu", "--json", "--dfu").stdout)
    assert [without["checks"][0]["outcome"], with_dfu["checks"][0]["outcome"]] == ["not run", "passed"]


def test_calibration_writes_can_be_forbidden(monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = (URL, "--only", "commit_puts_a_record_in_use", "--json", "--no-calibration-write")
    result = invoke(monkeypatch, Responder, *arguments)
    assert json.loads(result.stdout)["checks"][0]["outcome"] == "not run"
    assert result.exit_code == 0


def test_a_record_that_could_not_be_put_back_is_saved(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(monkeypatch, FlashOfOneWrite, URL, "--only", "commit_puts_a_record_in_use")
    assert result.exit_code == 1
    assert "The device is not as it was" in result.stderr
    saved = tmp_path / "calibration-000102030405060708090a0b.bin"
    assert saved.name in result.stderr
    assert saved.read_bytes() == Responder().record


def test_list_needs_no_device(monkeypatch: pytest.MonkeyPatch) -> None:
    result = invoke(monkeypatch, Responder, "--list")
    assert result.exit_code == 0
    assert result.stdout == as_markdown(all_checks())


def test_names_are_unique_and_every_rule_is_a_sentence() -> None:
    checks = all_checks()
    names = [check.name for check in checks] + [group.name for group in GROUPS]
    assert len(set(names)) == len(names)
    for check in checks:
        assert check.rule.endswith("."), check.name


def test_the_page_lists_the_checks_that_there_are() -> None:
    page = (ROOT / "docs/conformance.md").read_text()
    listed = page.partition("## Checks\n\n")[2]
    assert listed == as_markdown(all_checks()), (
        "put the output of `ribbonhil conformance --list` below ## Checks"
    )


def test_every_clause_is_a_heading_of_the_protocol() -> None:
    headings = re.findall(r"^## (.+)$", (ROOT / "protocol/PROTOCOL.md").read_text(), re.MULTILINE)
    assert {check.clause for check in all_checks()} <= set(headings)
