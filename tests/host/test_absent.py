"""Ribbons that are not there at the start join by themselves, or a sentence says why not."""

import io
import json
import signal
from pathlib import Path

import pytest
from host.fake_ribbon import NODES, FakeRibbon, served
from host.running_comb import SERIALS, check_replay, running
from host.test_cli import start
from ribbonhost import wire
from ribbonhost.cli.table import summary_of, table_of
from ribbonhost.device import Device, absent_device
from ribbonhost.link import Link
from ribbonhost.pipeline.arrangement import arrange_curves
from ribbonhost.record import Lost, Recording
from rich.console import Console

pytestmark = pytest.mark.usefixtures("ports")


def test_a_ribbon_that_was_absent_joins_and_the_recording_knows(tmp_path: Path) -> None:
    path = tmp_path / "late.mcap"
    with running(path, absent=[1]) as run:
        run.recorder.count_from_here()
        before = run.until(lambda report: report.comb.surfaces >= 20)
        assert [ribbon.state for ribbon in before.ribbons] == ["streaming", "absent"] + 2 * ["streaming"]
        assert before.summary_as_json()["summary"]["ribbons"] == 3
        assert Recording(path).header.ribbons[1].is_absent
        fake = run.fakes[1]
        fake.rate_hz, fake.mode, fake.vanished = 50, wire.Mode.ORIENT, False
        joined = run.until(lambda now: now.ribbons[1].state == "streaming" and now.ribbons[1].aligned)
        assert (fake.rate_hz, fake.mode) == (100, wire.Mode.ORIENT)
        run.until(lambda report: report.comb.surfaces >= joined.comb.surfaces + 30)
        report = run.stream.report()
    late = report.ribbons[1]
    assert late.counters.frames >= 30
    assert (late.times_gone, late.clock_restarts) == (1, 1)
    assert [ribbon.counters.lost for ribbon in report.ribbons if ribbon is not late] == [0] * 3
    told = [what for label, what in run.events if label == "at 0 m"]
    assert any(what.startswith(f"is back on {run.urls[1]} after") for what in told)
    assert "has joined" in told
    header = Recording(path).header.ribbons[1]
    assert (header.serial, header.port, header.node_count) == (SERIALS[1], run.urls[1], NODES)
    assert not header.is_absent
    first = next(item for item in Recording(path).items() if item.ribbon == 1)
    assert isinstance(first, Lost)
    check_replay(path, run.solved, late.gone_s)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"pitch_m": 0.03}, "it has a pitch of 0.03 m where the comb file says 0.025 m"),
        ({"node_count": 3}, "it has 3 nodes where the reference has 4"),
        ({"rate_max_hz": 60, "rate_hz": 50}, "it scans at most 60 times a second, and the others 100"),
        ({"oldest_host_version": 200}, "needs a host that speaks at least 200"),
        ({"node_count": 1}, "says of itself what cannot be: 1 nodes"),
    ],
)
def test_an_absent_ribbon_that_cannot_join_is_refused_once(
    tmp_path: Path, changes: dict[str, object], why: str
) -> None:
    with running(tmp_path / "odd.mcap", absent=[2]) as run:
        fake = run.fakes[2]
        fake.info_changes, fake.vanished = changes, False
        run.until(lambda _: run.has_told(why))
        frames = run.stream.report().comb.frames
        report = run.until(lambda report: report.comb.frames >= frames + 60)
        assert [ribbon.state for ribbon in report.ribbons].count("streaming") == 3
        assert report.ribbons[2].state == "absent"
        assert sum(why in what for _, what in run.events) == 1
        assert {code for code, _ in fake.commands} <= {wire.CommandCode.GET_INFO}


def test_a_stranger_on_a_port_that_was_named_is_refused(tmp_path: Path) -> None:
    with running(tmp_path / "stranger.mcap", absent=[3]) as run:
        run.fakes[3].serial, run.fakes[3].vanished = "ff" * 12, False
        run.until(lambda _: run.has_told(f"ribbon {'ff' * 12} on {run.urls[3]} is none of this stream's"))
        assert run.stream.report().ribbons[3].state == "absent"


def test_without_the_reference_ribbons_are_shown_on_a_line_until_it_joins(tmp_path: Path) -> None:
    path = tmp_path / "reference.mcap"
    with running(path, absent=[0]) as run:
        run.recorder.count_from_here()
        report = run.until(lambda report: report.comb.frames >= 30)
        assert report.ribbons[0].state == "absent"
        assert report.comb.surfaces == 0
        comb = run.solved[-1].comb
        assert comb is not None
        assert comb.anchor_m[1:].tolist() == [[0, 0, 0], [0.05, 0, 0], [0.1, 0, 0]]
        assert run.stream.over == (
            f"the reference ribbon is absent: ribbon {SERIALS[0]} is not there; "
            "meanwhile the others start on a straight line, and no surface counts"
        )
        run.fakes[0].vanished = False
        run.until(lambda report: report.comb.surfaces >= 20)
        assert run.stream.over == ""
        gone_s = run.stream.report().ribbons[0].gone_s
    check_replay(path, run.solved, gone_s, ribbon=0)


def test_an_absent_ribbon_of_no_comb_is_taken_to_be_like_the_first() -> None:
    first = Device(Link(FakeRibbon(serial=SERIALS[1]), "port 1"))
    first.handshake()
    arrangement = arrange_curves([first], [absent_device("", "port 2")])
    first.close()
    place = arrangement.places[1]
    assert (place.label, place.serial, place.node_count) == ("port 2", "", NODES)
    assert place.pitch_m == arrangement.places[0].pitch_m
    assert arrangement.notes[1] == "the ribbon on port 2 is not there: it joins when it is"


def test_a_stream_of_curves_counts_an_absent_ribbon_and_lets_it_join(tmp_path: Path) -> None:
    path = tmp_path / "curves.mcap"
    late = FakeRibbon(serial=SERIALS[1])
    late.vanish()
    with served(FakeRibbon(serial=SERIALS[0])) as url, served(late) as late_url:
        process = start("stream", url, late_url, "--json", "--motion", "off", "--record", str(path))
        assert process.stdout
        lines = [json.loads(process.stdout.readline())]

        def until(what: str) -> None:
            while len(lines) < 60 and what not in str(lines[-1]):
                assert process.stdout
                lines.append(json.loads(process.stdout.readline()))

        until("'state': 'absent'")
        late.vanished = False
        until("has joined")
        until(f"'serial': '{SERIALS[1]}', 'state': 'streaming'")
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (0, "")
    assert '"ribbons": 2' in out
    assert [ribbon.serial for ribbon in Recording(path).header.ribbons] == SERIALS[:2]


def test_without_reconnect_an_absent_ribbon_is_left_out(tmp_path: Path) -> None:
    late = FakeRibbon(serial=SERIALS[1])
    late.vanish()
    with served(FakeRibbon(serial=SERIALS[0])) as url, served(late) as late_url:
        process = start(
            "stream", url, late_url, "--json", "--motion", "off", "--no-reconnect", "--seconds", "0.3"
        )
        out, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (0, "")
    summary = json.loads(out.splitlines()[-1])["summary"]
    assert summary["ribbons"] == 1
    assert "absent" not in out


def test_the_table_says_who_is_absent_and_the_summary_who_never_joined(tmp_path: Path) -> None:
    with running(tmp_path / "shown.mcap", absent=[2]) as run:
        report = run.until(lambda report: report.comb.frames >= 5)
    console = Console(width=80, file=io.StringIO(), record=True)
    console.print(table_of(report))
    (row,) = [line for line in console.export_text().splitlines() if "at 0.05 m" in line]
    assert row.split()[3] == "absent"
    assert summary_of(report).endswith("at 0.05 m: it never joined.")
