"""Ribbons whose ports vanish are found again, wherever they come back, and the others go on meanwhile."""

import json
import signal
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from host.fake_ribbon import FakeRibbon, served
from host.running_comb import SERIALS, check_replay, running
from host.test_cli import start
from ribbonhost import wire
from ribbonhost.record import Back, Lost, Recording

LEFT = "at 0 m"

pytestmark = pytest.mark.usefixtures("ports")


def test_an_unplugged_ribbon_is_set_up_again_when_it_is_back_and_the_recording_knows(tmp_path: Path) -> None:
    path = tmp_path / "gap.mcap"
    with running(path) as run:
        run.recorder.count_from_here()
        fake = run.fakes[1]
        fake.vanish()
        before = run.until(lambda report: report.ribbons[1].state == "gone")
        run.until(lambda report: report.comb.surfaces >= before.comb.surfaces + 80)
        fake.commands.clear()
        fake.rate_hz, fake.mode, fake.vanished = 50, 0, False
        gone = run.until(lambda report: report.ribbons[1].state == "streaming" and report.ribbons[1].aligned)
        assert (fake.rate_hz, fake.mode) == (100, wire.Mode.ORIENT)
        assert wire.CommandCode.SET_PHASE in [code for code, _ in fake.commands]
        run.until(lambda report: report.comb.surfaces >= gone.comb.surfaces + 30)
        report = run.stream.report()
    left = report.ribbons[1]
    assert left.times_gone == 1
    assert 0.5 < left.gone_s < 10
    assert left.counters.sequence_jumps == 0
    assert left.counters.crc_errors == 0
    assert [(ribbon.times_gone, ribbon.counters.lost) for ribbon in report.ribbons if ribbon is not left] == [
        (0, 0)
    ] * 3
    told = [what for label, what in run.events if label == LEFT]
    assert "vanished" in told[0]
    assert "looked for" in told[0]
    assert any(what.startswith("is back on socket://127.0.0.1:") for what in told)
    items = [item for item in Recording(path).items() if item.ribbon == 1]
    (lost,) = [item for item in items if isinstance(item, Lost)]
    (back,) = [item for item in items if isinstance(item, Back)]
    assert back.t_host_s - lost.t_host_s == pytest.approx(left.gone_s, abs=1e-6)
    check_replay(path, run.solved, left.gone_s)


@pytest.mark.parametrize("how", ["a new serial port", "a port that the user named"])
def test_a_ribbon_is_found_on_a_port_of_another_name(
    tmp_path: Path, ports: list[str], monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    with ExitStack() as stack, running(tmp_path / "moved.mcap") as run:
        run.fakes[2].vanish()
        run.until(lambda report: report.ribbons[2].state == "gone")
        twin = FakeRibbon(serial=SERIALS[2])
        stranger = FakeRibbon(serial="ff" * 12)
        urls = [stack.enter_context(served(fake)) for fake in (stranger, twin)]
        if how == "a new serial port":
            ports += urls
        else:
            monkeypatch.setenv("RIBBONHOST_PORTS", " ".join(urls))
        run.until(lambda report: report.ribbons[2].state == "streaming")
        assert run.devices[2].name == urls[1]
        assert run.has_told(f"is back on {urls[1]} after")
        assert {code for code, _ in stranger.commands} <= {wire.CommandCode.GET_INFO}


def test_ports_that_were_there_before_are_left_alone(tmp_path: Path, ports: list[str]) -> None:
    """To open one restarts some boards."""
    with ExitStack() as stack:
        other = FakeRibbon(serial="ff" * 12)
        ports.append(stack.enter_context(served(other)))
        run = stack.enter_context(running(tmp_path / "alone.mcap"))
        run.fakes[3].vanish()
        run.until(lambda report: report.ribbons[3].gone_s > 0.8)
        assert other.commands == []


def test_a_ribbon_that_comes_back_with_another_serial_number_is_not_taken(tmp_path: Path) -> None:
    with running(tmp_path / "other.mcap") as run:
        run.fakes[1].vanish()
        run.until(lambda report: report.ribbons[1].state == "gone")
        run.fakes[1].serial, run.fakes[1].vanished = "ee" * 12, False
        run.until(lambda report: report.ribbons[1].gone_s > 1.0)
        assert run.stream.report().ribbons[1].state == "gone"


def test_a_stream_waits_for_its_last_ribbon_and_goes_on(tmp_path: Path) -> None:
    fake = FakeRibbon(serial=SERIALS[0])
    with served(fake) as url:
        process = start("stream", url, "--json")
        assert process.stdout
        lines: list[dict[str, dict[str, object]]] = []

        def until(found: Callable[[dict[str, dict[str, object]]], bool]) -> None:
            while len(lines) < 40:
                assert process.stdout
                lines.append(json.loads(process.stdout.readline()))
                if found(lines[-1]):
                    return

        until(lambda line: "report" in line)
        fake.vanish()
        until(lambda line: "no ribbon is left: waiting" in str(line.get("event")))
        fake.vanished = False
        until(lambda line: "is back on" in str(line.get("event")))
        until(lambda line: "'state': 'streaming'" in str(line.get("report")))
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (0, "")
    assert "summary" in json.loads(out.splitlines()[-1])
