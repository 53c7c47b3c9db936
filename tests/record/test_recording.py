"""What is recorded survives whatever ends the recording, and the stream never pays for it."""

import json
import os
import random
import resource
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader
from record.conftest import COMMAND, HEADER, Command
from ribbonhost import wire
from ribbonhost.errors import RecordingError, UsageError
from ribbonhost.record import Event, Item, Lost, Received, Recorder, Recording, Spoiled, is_complete, recover
from ribbonhost.record import recorder as recorder_module
from ribbonhost.record.layout import nanoseconds

KILLS = int(os.environ.get("RIBBON_SOAK_KILLS", "4"))
LOST_MAX_S = 1.0
EMULATED = ["--emulate", "wing", "--ribbons", "2", "--rate", "50", "--motion", "off"]
PACKET = wire.encode(wire.ClockPong(tag=1, t_host_us=2, t_receive_us=3, t_transmit_us=4))


def recorded(path: Path, **options: object) -> Recorder:
    """A recorder that runs, with taps for three ribbons."""
    recorder = Recorder(path, **options)  # type: ignore[arg-type]
    recorder.taps = [recorder.tap() for _ in range(3)]  # type: ignore[attr-defined]
    recorder.start(HEADER)
    return recorder


def until(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline_s, "did not come true in 10 s"
        time.sleep(0.02)


def items_of(path: Path, kind: type[Item]) -> list[Item]:
    return [item for item in Recording(path).items() if isinstance(item, kind)]


def test_all_that_a_tap_is_told_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorder = Recorder(path)
    first, second = recorder.tap(), recorder.tap()
    first.received(b"\x07early", 99.5)
    recorder.start(HEADER)
    first.sent(PACKET, 100.0)
    second.received(PACKET, 100.000000001)
    second.spoiled(3, 4, 100.2)
    second.lost("pulled", 100.3)
    recorder.event("ribbon 1", "fell")
    recorder.count_from_here()
    recorder.close()
    assert is_complete(path)
    recording = Recording(path)
    assert recording.header == HEADER
    items = list(recording.items())
    assert items[0] == Received(0, 1, 99.5, b"\x07early"), "what came before the file was begun is in it"
    assert [type(item).__name__ for item in items[1:]] == ["Sent", "Received", "Spoiled", "Lost"] + 2 * [
        "Event"
    ]
    assert items[2] == Received(1, 1, 100.000000001, PACKET)
    assert items[3] == Spoiled(1, 1, 100.2, 3, 4)
    assert items[4] == Lost(1, 1, 100.3, "pulled")
    assert isinstance(items[5], Event)
    assert (items[5].label, items[5].what) == ("ribbon 1", "fell")
    assert recording.t_zero_s == items[6].t_host_s
    assert recording.damaged == 0


def test_host_times_come_back_to_the_last_bit() -> None:
    draw = random.Random(0)
    for _ in range(2000):
        t_s = draw.randrange(100 * 24 * 3600 * 10**9) / 1e9
        assert nanoseconds(t_s) / 1e9 == t_s


def test_other_readers_of_mcap_open_it(wing: Path) -> None:
    with wing.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        messages = list(reader.iter_messages(topics=["/ribbon/0/received"]))
        times = [message.log_time for _, _, message in messages]
    assert summary.statistics.message_count > 3 * 400
    assert len(messages) > 400
    assert times == sorted(times)


def test_a_recording_says_what_it_is_of(wing: Path) -> None:
    header = Recording(wing).header
    assert [ribbon.label for ribbon in header.ribbons] == ["reference", "at 0 m", "at 0.15 m"]
    assert all(len(ribbon.serial) == 24 and ribbon.firmware for ribbon in header.ribbons)
    assert header.schema_hash == wire.SCHEMA_HASH
    assert "start_m = 0.15" in header.comb
    assert abs(header.wall_offset_ns + time.monotonic_ns() - time.time_ns()) < 3600 * 10**9
    numbers = [item.number for item in items_of(wing, Received) if item.ribbon == 1]
    assert numbers == list(range(1, len(numbers) + 1)), "a gap in the numbers is a gap in the recording"


@pytest.mark.parametrize("kill", range(KILLS))
def test_a_killed_recording_loses_at_most_a_second(tmp_path: Path, kill: int) -> None:
    path = tmp_path / "killed.mcap"
    process = subprocess.Popen(
        [*COMMAND, "record", str(path), *EMULATED], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    until(lambda: path.exists() and path.stat().st_size > 40_000)
    time.sleep(random.Random(kill).uniform(0, 1.2))
    process.send_signal(signal.SIGKILL)
    t_killed_s = time.monotonic()
    process.wait(timeout=10)
    assert not is_complete(path)
    saved = recover(path)
    assert is_complete(path)
    assert saved.damaged == 0
    last_s = max(item.t_host_s for item in items_of(path, Received))
    assert t_killed_s - last_s <= LOST_MAX_S


def test_a_full_disk_ends_the_recording_and_not_the_stream(tmp_path: Path) -> None:
    """A limit on the file's length fails writes as a full disk does."""
    path = tmp_path / "full.mcap"
    limit = 60_000
    done = subprocess.run(
        [*COMMAND, "record", str(path), *EMULATED, "--seconds", "3", "--json"],
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    events = [line["event"] for line in lines if "event" in line]
    assert [event["ribbon"] for event in events] == ["recording"], "one message"
    assert "File too large" in events[0]["what"]
    assert f"{path} holds what was recorded until then; the stream goes on" in events[0]["what"]
    summary = next(line["summary"] for line in lines if "summary" in line)
    assert summary["surfaces"] >= 0.7 * 3 * 50
    assert lines[-1]["recording"]["ended"] == "File too large"
    assert path.stat().st_size <= limit
    assert is_complete(path)
    recording = Recording(path)
    assert len(list(recording.items())) > 100
    assert recording.damaged == 0


def test_a_nearly_full_disk_is_said_before_it_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = [3 << 20]
    monkeypatch.setattr(recorder_module, "free_bytes", lambda path: room[0])
    events: list[str] = []
    path = tmp_path / "a.mcap"
    recorder = recorded(path, on_event=lambda label, what: events.append(what))
    for number in range(30_000):
        recorder.taps[0].received(PACKET, float(number))  # type: ignore[attr-defined]
    until(lambda: events)
    assert "more minutes: make room" in events[0]
    room[0] = 1000
    until(lambda: recorder.ended)
    recorder.close()
    assert "the disk is full" in recorder.ended
    assert len(events) == 2
    assert is_complete(path)
    assert len(items_of(path, Received)) == 30_000


def test_a_disk_that_does_not_keep_up_costs_the_recording_only_and_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "QUEUE_ITEMS", 10)
    monkeypatch.setattr(recorder_module, "DRAIN_S", 0.3)
    events: list[str] = []
    path = tmp_path / "a.mcap"
    recorder = recorded(path, on_event=lambda label, what: events.append(what))
    begin_s = time.monotonic()
    for number in range(1000):
        recorder.taps[0].received(PACKET, float(number))  # type: ignore[attr-defined]
    assert time.monotonic() - begin_s < 10, "nobody waits: each of 1,000 would wait 0.3 s"
    until(lambda: events)
    recorder.close()
    kept = items_of(path, Received)
    assert len(kept) + recorder.given_up == 1000
    assert "messages were not recorded" in events[0]
    assert any("not recorded" in item.what for item in items_of(path, Event) if isinstance(item, Event))


def test_a_rotated_recording_is_whole_files_each_of_which_knows_the_ribbons(tmp_path: Path) -> None:
    rotate = ["--rotate-s", "1"]
    done = subprocess.run(
        [*COMMAND, "record", str(tmp_path / "r.mcap"), *EMULATED, "--seconds", "3", "--json", *rotate],
        capture_output=True,
        text=True,
        timeout=60,
    )
    parts = sorted(tmp_path.glob("r-*.mcap"))
    assert json.loads(done.stdout.splitlines()[-1])["recording"]["files"] == [str(path) for path in parts]
    assert len(parts) >= 3
    received: list[int] = []
    for number, path in enumerate(parts, start=1):
        assert is_complete(path)
        recording = Recording(path)
        assert recording.header.part == number
        mine = [item for item in recording.items() if isinstance(item, Received) and item.ribbon == 1]
        assert wire.PacketId.INFO in [item.packet[0] for item in mine]
        received += [item.number for item in mine if item.number]
    assert received == list(range(1, len(received) + 1)), "nothing is lost between files"


def test_rotation_by_size_keeps_files_small(tmp_path: Path) -> None:
    recorder = recorded(tmp_path / "r.mcap", rotate_bytes=100_000)
    for number in range(60):
        for _ in range(100):
            recorder.taps[0].received(PACKET, float(number))  # type: ignore[attr-defined]
        time.sleep(0.03)
    recorder.close()
    assert len(recorder.paths) >= 2
    assert all(path.stat().st_size < 250_000 for path in recorder.paths)
    assert sum(len([i for i in items_of(path, Received) if i.number]) for path in recorder.paths) == 6000


def test_a_recording_is_not_overwritten_unless_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(UsageError, match="--force"):
        Recorder(path)
    assert path.read_bytes() == b"precious"
    recorded(path, force=True).close()
    assert is_complete(path)
    with pytest.raises(UsageError, match="no folder"):
        Recorder(tmp_path / "none" / "a.mcap")
    with pytest.raises(UsageError, match="is a folder"):
        Recorder(tmp_path, force=True)


def test_a_stream_that_cannot_begin_leaves_no_file(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    assert command("record", path, "/dev/ttyNONE").returncode == 1
    assert not path.exists()


def test_what_is_no_recording_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    for content, message in ((b"", "not an MCAP file"), (b"hello" * 100, "not an MCAP file")):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=message):
            Recording(path)
    with pytest.raises(RecordingError, match="No such file"):
        Recording(tmp_path / "none.mcap")


def test_what_is_known_of_a_ribbon_that_joined_stands_in_this_part_and_the_next(tmp_path: Path) -> None:
    absent = replace(HEADER.ribbons[0], port="", firmware="")
    known = replace(HEADER.ribbons[0], port="COM7", firmware="0.1.0", calibration_record=b"\1\2")
    recorder = Recorder(tmp_path / "late.mcap", rotate_bytes=20_000)
    tap = recorder.tap()
    recorder.start(replace(HEADER, ribbons=(absent, *HEADER.ribbons[1:])))
    tap.sent(bytes(9000), 1.0)
    recorder.describe((known, *HEADER.ribbons[1:]))
    tap.sent(bytes(9000), 2.0)
    while len(recorder.paths) < 2:
        tap.sent(bytes(9000), 3.0)
        time.sleep(0.05)
    recorder.close()
    assert [Recording(path).header.ribbons[0] for path in recorder.paths] == [known] * len(recorder.paths)
    recover(recorder.paths[0])
    assert Recording(recorder.paths[0]).header.ribbons[0] == known
