"""`ribbonhost doctor` finds what is wrong, says what to do, and ends accordingly."""

import errno
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial
from host.fake_ribbon import FakeRibbon, info_packet, status_packet
from ribbonhost import wire
from ribbonhost.cli import doctor_checks as checks
from ribbonhost.cli.doctor_checks import Verdict

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def enough_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks, "DISK_BYTES", 1)


def test_a_healthy_machine_and_ribbon_pass(run: Run, urls: list[str]) -> None:
    code, out, err = run("doctor", urls[0])
    assert (code, err) == (0, "")
    lines = out.splitlines()
    names = " ".join(lines)
    for name in ("solver", "clock", "disk", "permissions", "emulator", "ribbon 21d70000 firmware"):
        assert name in names
    assert {line.split()[0] for line in lines} <= {"ok", "note"}
    assert any("all 8 read" in line for line in lines)
    assert "\x1b" not in out


def test_a_ribbon_with_a_broken_slot_fails_by_name_and_json_says_so(
    run: Run, urls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = status_packet()
    broken.slots.reason[5] = wire.SlotReason.STUCK
    monkeypatch.setattr("host.fake_ribbon.status_packet", lambda: broken)
    code, out, err = run("doctor", urls[0], "--json")
    assert code == 1
    assert "1 of" in err
    assert "ribbon 21d70000 slots" in err
    (failed,) = [check for check in json.loads(out)["checks"] if check["verdict"] == "fail"]
    assert failed["what"].startswith("1 of 8 not used (stuck: 5): check the connectors")


def test_a_port_without_permission_fails_with_the_command_to_type(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(url: str, **settings: Any) -> None:
        raise serial.SerialException(errno.EACCES, f"could not open port {url}: Permission denied")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    code, out, err = run("doctor", "/dev/ttyACM0")
    assert code == 1
    assert "permissions" in err
    assert "type `sudo usermod -a -G" in out


def test_no_ribbon_is_a_note(run: Run) -> None:
    code, out, _ = run("doctor")
    assert code == 0
    assert "plug one in" in out


def test_a_ribbon_that_vanishes_in_between_is_a_failure(run: Run, urls: list[str]) -> None:
    port = checks.FoundPort("socket://127.0.0.1:1", checks.PortState.RIBBON, info=info_packet())
    (check,) = checks.ribbon_checks(port, 921_600)
    assert check.verdict is Verdict.FAIL
    assert "nothing listens there" in check.what


def test_a_ribbon_that_sends_no_status_is_a_failure(
    run: Run, urls: list[str], fakes: list[FakeRibbon]
) -> None:
    fakes[0].refused = {wire.CommandCode.GET_STATUS: wire.AckCode.UNSUPPORTED}
    code, _, err = run("doctor", urls[0])
    assert code == 1
    assert "ribbon 21d70000" in err


@pytest.mark.parametrize(
    ("changes", "verdict", "words"),
    [
        ({}, Verdict.OK, "last started by power_on"),
        ({"reset_cause": wire.ResetCause.WATCHDOG}, Verdict.FAIL, "by watchdog"),
        ({"fault_pc": 0x0800_1234}, Verdict.FAIL, "hard fault at 0x08001234"),
    ],
)
def test_the_last_start_is_judged(changes: dict[str, Any], verdict: Verdict, words: str) -> None:
    check = checks.reset_check("r", replace(status_packet(), **changes))
    assert check.verdict is verdict
    assert words in check.what


def test_slots_out_of_range_are_sent_away_from_iron() -> None:
    status = status_packet()
    status.slots.reason[:] = np.where(np.arange(8) % 2, wire.SlotReason.OUT_OF_RANGE, wire.SlotReason.OK)
    check = checks.slots_check("r", info_packet(), status)
    assert check.verdict is Verdict.FAIL
    assert "4 of 8 not used (out_of_range: 1, 3, 5, 7): move it away from magnets" in check.what


def test_another_schema_is_a_note_that_says_which_side_is_behind() -> None:
    info = info_packet(schema_hash=wire.SCHEMA_HASH ^ 1, wire_version=wire.WIRE_VERSION + 1)
    check = checks.version_check("r", info)
    assert check.verdict is Verdict.NOTE
    assert "a later ribbonhost" in check.what
    assert checks.version_check("r", info_packet()).verdict is Verdict.OK


def test_dropped_frames_and_missing_calibration_are_notes() -> None:
    check = checks.losses_check("r", replace(status_packet(), frames_dropped=3))
    assert check.verdict is Verdict.NOTE
    assert "rate-test" in check.what
    assert checks.calibration_check("r", info_packet()).verdict is Verdict.NOTE
    assert checks.calibration_check("r", info_packet(calibration_sequence=2)).verdict is Verdict.OK


def test_a_full_disk_and_a_coarse_clock_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert checks.disk_check(Path("/x"), (1 << 30) - 1).verdict is Verdict.FAIL
    assert checks.disk_check(Path("/x"), 1 << 30).verdict is Verdict.OK
    assert checks.clock_check(0.0156).verdict is Verdict.FAIL
    assert checks.clock_check(1e-7).verdict is Verdict.OK


def test_a_usb_interface_without_driver_fails(tmp_path: Path) -> None:
    for name, kind, has_driver in (
        ("1-1:1.0", "02", True),
        ("1-2:1.0", "02", False),
        ("1-3:1.0", "08", False),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "bInterfaceClass").write_text(f"{kind}\n")
        if has_driver:
            os.symlink(tmp_path, tmp_path / name / "driver")
    check = checks.driver_check(tmp_path)
    assert check.verdict is Verdict.FAIL
    assert check.what == "USB serial interface 1-2:1.0 has no driver: type `sudo modprobe cdc_acm`"
    assert checks.driver_check(tmp_path / "none").verdict is Verdict.OK


def test_an_extra_that_is_missing_is_a_note() -> None:
    found = list(
        checks.extras_checks(["numpy>=1", 'numpy>=1; extra == "a"', 'no-such-library; extra == "b"'])
    )
    assert [(check.name, check.verdict) for check in found] == [
        ("extra a", Verdict.OK),
        ("extra b", Verdict.NOTE),
    ]
    assert 'pip install "ribbonhost[b]"' in found[1].what
