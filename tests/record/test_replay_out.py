"""A replay sends its frames to other programs, as the stream would."""

import json
from pathlib import Path

import numpy as np
from record.conftest import Command


def test_a_replay_sends_what_an_export_writes(command: Command, wing: Path, tmp_path: Path) -> None:
    done = command("replay", wing, "--speed", "8", "--from", "1", "--out", "ndjson")
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    hello = next(line["ribbons"] for line in lines if "ribbons" in line)
    assert [ribbon["name"] for ribbon in hello["ribbons"]] == ["reference", "at 0 m", "at 0.15 m"]
    frames = [line["frame"] for line in lines if "frame" in line]
    out = next(line["out"] for line in lines if "out" in line)
    assert (out["target"], out["frames"]) == ("ndjson", len(frames))
    assert len(frames) > 50
    assert command("export", wing, "-o", tmp_path / "wing.npz", "--from", "1").returncode == 0
    with np.load(tmp_path / "wing.npz") as file:
        exported_m = file["node_m"]
    later = frames[10]  # the first may lie just before the second that both begin with
    nearest = np.abs(exported_m - np.array(later["node_m"])).max(axis=(1, 2, 3))
    assert nearest.min() < 1e-6
    assert any("summary" in line for line in lines)
