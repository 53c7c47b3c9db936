"""The command line: what it prints, to whom, and the exit code."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from host.command_line import Run, runner
from host.fake_ribbon import FakeRibbon, served
from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.wire import WIRE_VERSION, CommandCode

COMMAND = [sys.executable, "-c", "from ribbonhost.cli import main; main()"]
SERIALS = [f"{i:024x}" for i in range(1, 4)]
COMB = Comb(SERIALS[0], 0.025, (CombRibbon(SERIALS[1], 0.0), CombRibbon(SERIALS[2], 0.1)))


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `ribbonhost` with arguments in this process; returns its exit code, stdout and stderr."""
    return runner(monkeypatch, capsys)


@pytest.fixture
def fakes() -> list[FakeRibbon]:
    return [FakeRibbon(serial=serial) for serial in SERIALS]


@pytest.fixture
def urls(fakes: list[FakeRibbon]) -> Iterator[list[str]]:
    with ExitStack() as stack:
        yield [stack.enter_context(served(fake)) for fake in fakes]


@pytest.fixture
def comb_file(tmp_path: Path) -> Path:
    path = tmp_path / "comb.toml"
    path.write_text(COMB.to_toml())
    return path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["stream"], "no ribbon was named"),
        (["stream", "a", "--emulate", "wing"], "--emulate brings its own ribbons"),
        (["stream", "--emulate", "wing", "--comb", "x.toml"], "--emulate brings its own ribbons"),
        (["stream", "a", "--ribbons", "3"], "--ribbons is for --emulate only"),
        (["stream", "a", "--seed", "3"], "--seed is for --emulate only"),
        (["stream", "a", "--method", "guess"], "--method guess is not one of "),
        (["stream", "a", "--seconds", "inf"], "--seconds inf is no duration"),
        (["stream", "a", "a"], "a is given twice"),
        (["stream", "a", "--comb", "none.toml"], "none.toml: cannot be read"),
        (["stream", "--emulate", "wing", "--rate", "201"], "--rate"),
        (["stream", "--emulate", "wing", "--ribbons", "1"], "--ribbons"),
        (["stream", "pigeon://a"], "protocol 'pigeon' not known"),
        (["stream", "pigeon://a", "/dev/ttyNONE"], "protocol 'pigeon' not known"),
        (["fly"], "No such command"),
        (["info"], "Missing argument"),
    ],
)
def test_wrong_usage_is_a_sentence_and_exit_code_2(run: Run, arguments: list[str], message: str) -> None:
    code, out, err = run(*arguments)
    assert code == 2
    assert message in err
    assert out == ""
    assert "Traceback" not in err


def test_without_devices_it_says_what_was_looked_for_and_what_to_type(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ribbonhost.cli.stream.ports_seen", lambda: ["/dev/ttyACM3 (ribbon)", "/dev/ttyS0"])
    code, _, err = run("stream")
    assert code == 2
    assert "Serial ports here: /dev/ttyACM3 (ribbon), /dev/ttyS0." in err
    assert "`ribbonhost stream --emulate wing`" in err
    monkeypatch.setattr("ribbonhost.cli.stream.ports_seen", list)
    assert "No serial port was found." in run("stream")[2]


def test_a_port_that_does_not_exist_is_a_failure(run: Run) -> None:
    for command in ("stream", "info"):
        code, _, err = run(command, "/dev/ttyNONE")
        assert code == 1
        assert "cannot open /dev/ttyNONE: there is no such port" in err
    code, _, err = run("stream", "/dev/ttyNONE", "/dev/ttyNONE2")
    assert code == 1
    assert "none of the 2 ports has a ribbon" in err


def test_a_defect_is_admitted_without_a_traceback(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("ribbonhost.cli.stream.run_stream", fail)
    code, _, err = run("stream", "a")
    assert code == 1
    assert "a defect of this program: ZeroDivisionError: by zero" in err
    assert "Traceback" not in err


def test_json_lines_end_with_the_summary(run: Run, urls: list[str], comb_file: Path) -> None:
    code, out, err = run("stream", *urls, "--comb", comb_file, "--seconds", 1.2, "--json", "--motion", "off")
    assert (code, err) == (0, "")
    *reports, last = [json.loads(line) for line in out.splitlines()]
    assert [set(report) for report in reports] == [{"report"}] * len(reports)
    ribbon = reports[-1]["report"]["ribbons"][1]
    assert ribbon["ribbon"] == "at 0 m"
    assert ribbon["serial"] == SERIALS[1]
    summary = last["summary"]
    assert list(summary) == [
        "ribbons",
        "rate_hz",
        "frames",
        "lost",
        "crc_errors",
        "invalid_nodes",
        "surfaces",
        "latency_ms",
        "age_ms",
        "cpu_percent",
        "error_percent",
    ]
    assert (summary["ribbons"], summary["rate_hz"], summary["lost"], summary["crc_errors"]) == (3, 100, 0, 0)
    assert summary["frames"] == pytest.approx(3 * 120, rel=0.1)
    assert summary["surfaces"] > 100
    assert set(summary["latency_ms"]) == {"p50", "p99"}
    assert summary["error_percent"] is None


def test_curves_without_a_comb_are_said_to_be_so(run: Run, urls: list[str]) -> None:
    code, out, err = run("stream", *urls[:1], "--seconds", 0.3)
    assert code == 0
    assert "curves only" in err
    assert "curves, no surface" in out
    assert "frames/s" in out


def test_a_port_that_fails_does_not_stop_the_others(run: Run, urls: list[str], comb_file: Path) -> None:
    code, out, err = run("stream", *urls, "/dev/ttyNONE", "--comb", comb_file, "--seconds", 0.3, "--rate", 50)
    assert code == 0
    assert "cannot open /dev/ttyNONE" in err
    assert "3 ribbons in 0.3 s" in out


def test_a_rate_that_a_ribbon_cannot_do_is_wrong_usage(
    run: Run, urls: list[str], fakes: list[FakeRibbon]
) -> None:
    fakes[0].info_changes = {"rate_max_hz": 60, "rate_hz": 10}
    code, _, err = run("stream", *urls[:1], "--rate", 80)
    assert code == 2
    assert "scans at most 60 times a second" in err
    code, out, err = run("stream", *urls[:1], "--seconds", 0.2, "--json")
    assert code == 0
    assert json.loads(out.splitlines()[-1])["summary"]["rate_hz"] == 60
    assert "at most 60" in json.loads(out.splitlines()[0])["note"] + json.loads(out.splitlines()[1])["note"]


def test_a_later_schema_is_noted(run: Run, urls: list[str], fakes: list[FakeRibbon]) -> None:
    fakes[0].info_changes = {"wire_version": WIRE_VERSION + 1, "schema_hash": 1}
    code, _, err = run("stream", *urls[:1], "--seconds", 0.2)
    assert code == 0
    assert f"speaks wire version {WIRE_VERSION + 1} with another schema" in err


def test_without_reconnection_the_last_ribbon_that_vanishes_ends_it_with_a_failure(
    urls: list[str], fakes: list[FakeRibbon]
) -> None:
    process = start("stream", urls[0], "--json", "--no-reconnect")
    assert process.stdout
    while "report" not in json.loads(process.stdout.readline()):
        pass
    fakes[0].vanish()
    out, err = process.communicate(timeout=20)
    assert process.returncode == 1
    lines = [json.loads(line) for line in out.splitlines()]
    assert any("vanished" in line["event"]["what"] for line in lines if "event" in line)
    assert "summary" in lines[-1]
    assert err == "ribbonhost: no ribbon is left\n"


def start(*arguments: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_being_told_to_stop_prints_the_summary_and_quiets_the_devices(
    urls: list[str], fakes: list[FakeRibbon], comb_file: Path, number: signal.Signals
) -> None:
    process = start("stream", *urls, "--comb", comb_file, "--json")
    assert process.stdout
    process.stdout.readline()
    process.send_signal(number)
    out, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (0, "")
    assert "summary" in json.loads(out.splitlines()[-1])
    assert [fake.commands[-1] for fake in fakes] == [(CommandCode.SET_MODE, 0)] * 3


def test_a_reader_that_leaves_ends_it_quietly(urls: list[str], fakes: list[FakeRibbon]) -> None:
    process = start("stream", urls[0], "--json")
    assert process.stdout
    process.stdout.readline()
    process.stdout.close()
    assert process.wait(timeout=20) == 0
    assert process.stderr
    assert process.stderr.read() == ""
    process.stderr.close()
    assert fakes[0].mode == 0


def test_a_reader_that_never_was_is_no_traceback(urls: list[str]) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    for arguments in (["info", urls[0], "--json"], ["info", urls[0]], ["--help"]):
        done = subprocess.run([*COMMAND, *arguments], stdout=write_end, stderr=subprocess.PIPE, text=True)
        assert done.stderr == ""
        assert done.returncode in (0, 1)
    os.close(write_end)


def test_a_live_table_is_drawn_on_a_terminal(urls: list[str], comb_file: Path) -> None:
    master, slave = os.openpty()
    process = subprocess.Popen(
        [*COMMAND, "stream", *urls, "--comb", str(comb_file), "--seconds", "1.2", "--motion", "off"],
        stdout=slave,
        stderr=slave,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "120"},
    )
    os.close(slave)
    shown = b""
    try:
        while chunk := os.read(master, 4096):
            shown += chunk
    except OSError:
        pass  # the terminal's end
    os.close(master)
    assert process.wait(timeout=20) == 0
    text = shown.decode()
    for word in ("reference", "at 0.1 m", "live", "frames/s", "CRC errors", "invalid nodes", "latency"):
        assert word in text
    assert text.count("frames/s") >= 2, "drawn anew"
    assert "3 ribbons in 1.2 s" in text


def test_info_prints_who_and_how_a_ribbon_is(run: Run, urls: list[str]) -> None:
    code, out, _ = run("info", urls[1])
    assert code == 0
    assert SERIALS[1] in out
    assert "lis2dw12: 4, mmc5983ma: 4" in out
    code, out, _ = run("info", urls[1], "--json")
    facts = json.loads(out)["info"]
    assert (facts["serial"], facts["nodes"], facts["temperature_c"]) == (SERIALS[1], 4, 25.0)


def test_help_is_quick_and_needs_nothing_slow() -> None:
    script = (
        "import sys; sys.argv = ['ribbonhost', '--help']\n"
        "from ribbonhost.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print(sorted({'numpy', 'scipy', 'rich', 'serial', 'cffi'} & set(sys.modules)))"
    )
    start_s = time.monotonic()
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "stream" in done.stdout
    assert time.monotonic() - start_s < 5.0  # 0.1 s on a machine with nothing else to do
