"""Decoded channels beside what was recorded: another reader opens them, and the replay stays the same."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from record.conftest import Command
from record.virtual import stream_virtually
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.solving import Solved
from ribbonhost.record import Recording

TOLERANCE_M = 1e-6


def replayed(path: Path) -> list[Solved]:
    """The frames from second 0 on."""
    frames: list[Solved] = []
    recording = Recording(path)
    for _ in Replay([recording], on_solved=[frames.append]).play():
        pass
    return [frame for frame in frames if frame.match.t_host_s >= recording.t_zero_s]


def test_decoded_channels_agree_and_the_replay_stays_the_same(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "wing.mcap"
    stream_virtually(path, monkeypatch)
    before = replayed(path)
    assert command("finalise", path, "-o", tmp_path / "once.mcap", "--rate", "20").returncode == 0
    done = command("finalise", tmp_path / "once.mcap", "--rate", "20", "--json")
    assert done.returncode == 0, done.stderr
    after = replayed(tmp_path / "once.mcap")
    assert len(after) == len(before)
    for one, other in zip(before, after, strict=True):
        assert one.match.t_host_s == other.match.t_host_s
        np.testing.assert_array_equal(one.node_m, other.node_m)
    check_decoded(tmp_path / "once.mcap", before, json.loads(done.stdout)["finalised"]["decoded"])


def check_decoded(path: Path, truth: list[Solved], count: int) -> None:
    header = Recording(path).header
    assert header.log_offset_ns == header.wall_offset_ns
    found: dict[str, list[tuple[float, np.ndarray, np.ndarray]]] = {}
    surfaces = 0
    messages = 0
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary
        topics = [c.topic for c in summary.channels.values() if c.message_encoding == "protobuf"]
        for schema, channel, raw, message in reader.iter_decoded_messages(topics=topics):
            messages += 1
            t_s = (raw.log_time - header.log_offset_ns) / 1e9
            if channel.topic == "/scene":
                assert schema is not None
                assert schema.name == "foxglove.SceneUpdate"
                surfaces += any(entity.id == "surface" and entity.triangles for entity in message.entities)
                continue
            poses = message.poses
            position_m = np.array([[p.position.x, p.position.y, p.position.z] for p in poses])
            q = np.array([[getattr(p.orientation, axis) for axis in "wxyz"] for p in poses])
            found.setdefault(channel.topic, []).append((t_s, position_m, q))
    assert messages == count
    assert set(found) == {"/poses/reference", "/poses/at 0 m", "/poses/at 0.15 m"}
    assert surfaces >= 0.9 * len(found["/poses/reference"])
    by_time = {round(frame.match.t_host_s, 6): frame for frame in truth}
    for index, topic in enumerate(("/poses/reference", "/poses/at 0 m", "/poses/at 0.15 m")):
        shown = [entry for entry in found[topic] if round(entry[0], 6) in by_time]
        assert 0.9 * 20 * 2 <= len(shown) <= 1.1 * 20 * 2, "two seconds, 20 a second"
        for t_s, position_m, q in shown:
            frame = by_time[round(t_s, 6)]
            assert np.abs(position_m - frame.node_m[index]).max() < TOLERANCE_M
            assert np.abs(q - frame.match.q_world_node[index]).max() < TOLERANCE_M


def test_a_file_that_is_there_is_kept_and_a_failure_leaves_the_recording(
    command: Command, wing: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "wing.mcap"
    path.write_bytes(wing.read_bytes())
    (tmp_path / "there.mcap").write_text("mine")
    done = command("finalise", path, "-o", tmp_path / "there.mcap")
    assert (done.returncode, (tmp_path / "there.mcap").read_text()) == (2, "mine")
    monkeypatch.setitem(__import__("sys").modules, "foxglove.messages", None)
    done = command("finalise", path)
    assert done.returncode == 1
    assert 'type `pip install "ribbonhost[export]"`' in done.stderr
    assert path.read_bytes() == wing.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["there.mcap", "wing.mcap"]
