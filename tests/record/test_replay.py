"""A recording that is played gives what the stream gave."""

import json
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from record.conftest import Command
from record.virtual import stream_virtually
from ribbonhil.emulator import EmulatedComb
from ribbonhost import wire
from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.device import Device, absent_device, open_device
from ribbonhost.link import register_emulator
from ribbonhost.pipeline.arrangement import arrange_comb
from ribbonhost.pipeline.header import header_of, recorded_ribbons
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.solving import Solved
from ribbonhost.pipeline.stream import Stream
from ribbonhost.reconstruct.comb import Method
from ribbonhost.record import Recorder, Recording


def replayed(*paths: Path, method: Method | None = None) -> tuple[Replay, list[Solved]]:
    """The frames from time 0 on."""
    solved: list[Solved] = []
    replay = Replay([Recording(path) for path in paths], method=method, on_solved=[solved.append])
    for _ in replay.play():
        pass
    return replay, [frame for frame in solved if frame.match.t_host_s >= replay.t_zero_s]


def assert_same(live: list[Solved], again: list[Solved]) -> None:
    """To the last bit."""
    assert [frame.match.t_host_s for frame in again] == [frame.match.t_host_s for frame in live]
    for one, other in zip(live, again, strict=True):
        assert one.comb is not None
        assert other.comb is not None
        np.testing.assert_array_equal(one.match.q_world_node, other.match.q_world_node)
        np.testing.assert_array_equal(one.match.valid, other.match.valid)
        np.testing.assert_array_equal(one.node_m, other.node_m)
        np.testing.assert_array_equal(one.comb.vertices_m, other.comb.vertices_m)
        np.testing.assert_array_equal(one.comb.normals, other.comb.normals)


def test_a_comb_in_virtual_time_is_replayed_to_the_last_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    live = stream_virtually(path, monkeypatch, spoil_at_s=1.0)
    replay, again = replayed(path)
    assert len(live) > 150
    first_s = live[0].match.t_host_s
    assert_same(live, [frame for frame in again if frame.match.t_host_s >= first_s])
    report = replay.report()
    assert [ribbon.counters.crc_errors for ribbon in report.ribbons] == [0, 1, 0]
    assert all(ribbon.counters.lost == ribbon.counters.unexpected == 0 for ribbon in report.ribbons)
    assert replay.damaged == 0


def test_what_was_streamed_live_is_replayed_to_the_last_bit(tmp_path: Path) -> None:
    register_emulator()
    live: list[Solved] = []
    with EmulatedComb(ribbons=2) as emulated:
        recorder = Recorder(tmp_path / "a.mcap")
        taps = [recorder.tap() for _ in emulated.urls]
        devices = [open_device(url, observer=tap) for url, tap in zip(emulated.urls, taps, strict=True)]
        first, *others = emulated.serials
        starts = zip(others, emulated.layout_start_m, strict=True)
        comb = Comb(first, emulated.pitch_m, tuple(CombRibbon(*start) for start in starts))
        arrangement = arrange_comb(devices, comb)
        channels = {device: tap.channel for device, tap in zip(devices, taps, strict=True)}
        recorder.start(header_of(arrangement, channels, comb=comb, rate_hz=100, method="hermite"))
        stream = Stream(arrangement, rate_hz=100, method="hermite", on_solved=[live.append])
        stream.start()
        emulated.plug(2, False)  # a ribbon that goes missing is part of what must be the same
        time.sleep(1.5)
        stream.close()
        recorder.close()
    solved: list[Solved] = []
    replay = Replay([Recording(recorder.paths[0])], on_solved=[solved.append])
    for _ in replay.play():
        pass
    assert replay.method == "hermite"
    assert len(live) > 100
    assert_same(live, solved)
    assert not live[-1].match.valid[2].any()
    assert replay.report().ribbons[2].state == "gone"


def test_the_motion_of_a_ribbon_that_joins_is_estimated_and_replayed_to_the_last_bit(tmp_path: Path) -> None:
    register_emulator()
    live: list[Solved] = []
    with EmulatedComb(ribbons=2) as emulated:
        emulated.plug(2, False)
        recorder = Recorder(tmp_path / "late.mcap")
        taps = [recorder.tap() for _ in emulated.urls]
        devices = [open_device(url, observer=tap) for url, tap in zip(emulated.urls[:2], taps, strict=False)]
        late = absent_device(emulated.serials[2], observer=taps[2])
        first, *others = emulated.serials
        starts = zip(others, emulated.layout_start_m, strict=True)
        comb = Comb(first, emulated.pitch_m, tuple(CombRibbon(*start) for start in starts))
        arrangement = arrange_comb(devices, comb, lambda serial: late)
        channels = {device: tap.channel for device, tap in zip([*devices, late], taps, strict=True)}
        calibrations: dict[str, wire.Calibration] = {}
        joined = threading.Event()

        def on_joined(device: Device) -> None:
            recorder.describe(recorded_ribbons(arrangement, channels, calibrations))
            joined.set()

        recorder.start(
            header_of(arrangement, channels, comb=comb, rate_hz=100, method="spline", motion="live")
        )
        stream = Stream(
            arrangement,
            rate_hz=100,
            on_solved=[live.append],
            reconnect=True,
            motion="live",
            calibrations=calibrations,
            named=emulated.urls[2:],
            on_joined=on_joined,
        )
        stream.start()
        emulated.plug(2, True)
        assert joined.wait(20)
        deadline_s = time.monotonic() + 20
        while live[-1].match.moving[2] is None and time.monotonic() < deadline_s:
            time.sleep(0.05)
        time.sleep(0.3)
        stream.close()
        recorder.close()
    assert live[-1].match.moving[2] is not None
    assert calibrations.keys() == {late.serial}
    assert Recording(recorder.paths[0]).calibrations().keys() == {late.serial}
    assert_same(live, replayed(recorder.paths[0])[1])


def test_another_method_gives_other_curves_of_the_same_readings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    live = stream_virtually(path, monkeypatch, seconds=0.5)
    _, again = replayed(path, method="hermite")
    again = again[-len(live) :]
    np.testing.assert_array_equal(live[-1].match.q_world_node, again[-1].match.q_world_node)
    apart_m = np.abs(live[-1].node_m - again[-1].node_m).max()
    assert 1e-6 < apart_m < 1e-2


def test_the_command_replays_at_the_speed_that_is_asked_for(wing: Path, command: Command) -> None:
    done = command("replay", wing, "--speed", "0", "--json")
    assert done.returncode == 0, done.stderr
    *reports, last = [json.loads(line) for line in done.stdout.splitlines()]
    assert last["summary"]["surfaces"] >= 0.8 * 4 * 100
    assert last["summary"]["lost"] == 0
    assert [round(line["report"]["t_s"]) for line in reports if "report" in line][:3] == [1, 2, 3]
    begin_s = time.monotonic()
    done = command("replay", wing, "--speed", "2", "--from", "2", "--json")
    assert time.monotonic() - begin_s > 0.9, "two seconds at twice the speed"
    surfaces = json.loads(done.stdout.splitlines()[-1])["summary"]["surfaces"]
    assert surfaces == pytest.approx(200, abs=20)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--from", "1000"], "ends at"),
        (["--method", "guess"], "is not one of"),
        (["--speed", "-1"], "--speed"),
    ],
)
def test_what_cannot_be_replayed_is_wrong_usage(
    wing: Path, command: Command, arguments: list[str], message: str
) -> None:
    done = command("replay", wing, *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_a_torn_recording_is_named_with_what_to_type(wing: Path, command: Command, tmp_path: Path) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(wing.read_bytes()[:-1000])
    done = command("replay", torn)
    assert done.returncode == 1
    assert done.stderr == (
        f"ribbonhost: {torn} was not closed: its writing was cut off; "
        f"type `ribbonhost recover {torn}`, then try again\n"
    )
    assert command("recover", torn).returncode == 0
    assert command("replay", torn, "--speed", "0").returncode == 0
