"""`ribbonhost finalise`: decoded channels beside what was recorded, for Foxglove and other viewers."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ribbonhost.cli.progress import Progress, progress_bar
from ribbonhost.cli.replay import open_recordings
from ribbonhost.export.foxglove import foxglove_encoder
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.solving import Solved
from ribbonhost.record import Decoded, Recording, finalise


def run_finalise(path: Path, output: Path | None, rate_hz: float, as_json: bool) -> None:
    """Writes the file, whole or not at all. Raises RecordingError, MissingExtraError."""
    (recording,) = open_recordings([path])
    target = output or path
    with progress_bar("decode") as progress:
        count = finalise(path, target, _decoded(recording, rate_hz, progress))
    size = target.stat().st_size
    if as_json:
        print(json.dumps({"finalised": {"file": str(target), "decoded": count, "bytes": size}}))
    else:
        print(f"{target}: {count} decoded messages beside what was recorded, {size / (1 << 20):.1f} MiB")


def _decoded(recording: Recording, rate_hz: float, progress: Progress) -> Iterator[Decoded]:
    solved_now: list[Solved] = []
    encode = foxglove_encoder()
    replay = Replay([recording], on_solved=[solved_now.append])
    labels = [place.label for place in replay.arrangement.places]
    unix_offset_s = recording.header.wall_offset_ns / 1e9
    due_s = dict.fromkeys(range(len(labels)), -np.inf)
    for count, _ in enumerate(replay.play()):
        for solved in solved_now:
            t_s, first = solved.match.t_host_s, solved.places[0]
            if t_s < due_s[first] - 0.1 / rate_hz:
                continue
            due_s[first] = max(due_s[first], t_s - 1 / rate_hz) + 1 / rate_hz
            names = [labels[place] for place in solved.places]
            for topic, schema, data in encode(
                t_s + unix_offset_s, names, solved.node_m, solved.match.q_world_node, solved.comb is not None
            ):
                yield Decoded(topic, schema, t_s, data)
        solved_now.clear()
        if count % 500 == 0:
            progress(recording.share)
