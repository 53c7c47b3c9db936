"""The page that plays a motion: complete, and with the positions that were reconstructed."""

import base64
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import zstandard
from export.made_up import NODES, RIBBONS, U, W, made_up
from export.test_export import TOLERANCE_M
from ribbonhost.export import Animation, Options, export
from ribbonhost.export.animation import grid_triangles

FRAMES = 12


@pytest.fixture
def animation() -> Animation:
    return made_up(FRAMES, seed=4)


def embedded(path: Path) -> tuple[dict[str, Any], list[bytes]]:
    """What the page plays: the messages, and the arrays that they point to by number."""
    found = re.search(r'__VISER_EMBED_DATA__="([^"]+)"', path.read_text())
    assert found
    inner = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(found[1])[8:])
    size = int.from_bytes(inner[:8], "little")
    played = msgspec.msgpack.decode(inner[8 : 8 + size])
    at, buffers = 8 + size, []
    for length in played["binaryBufferLengths"]:
        at += -at % 8
        buffers.append(inner[at : at + length])
        at += length
    return played, buffers


def test_a_page_plays_all_frames_and_asks_nothing_of_the_internet(
    animation: Animation, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "motion.html"
    export(animation, path)
    text = path.read_text()
    assert not re.search(r'(src|href)\s*=\s*"(https?:)?//', text)
    played, buffers = embedded(path)
    assert played["durationSeconds"] == pytest.approx(FRAMES / 20)
    surfaces = [np.frombuffer(data, np.float32).reshape(-1, 3) for data in buffers if len(data) == U * W * 12]
    assert len(surfaces) == FRAMES
    for shown, truth in zip(surfaces, animation.surface_m, strict=True):
        assert np.abs(shown - truth.reshape(-1, 3)).max() < TOLERANCE_M
    segments = RIBBONS * (NODES - 1)
    lines = [
        np.frombuffer(data, np.float32).reshape(RIBBONS, NODES - 1, 2, 3)
        for data in buffers
        if len(data) == segments * 24
    ]
    assert len(lines) == FRAMES
    for shown, node_m in zip(lines, animation.node_m, strict=True):
        assert np.abs(shown[:, :, 0] - node_m[:, :-1]).max() < TOLERANCE_M
        assert np.abs(shown[:, :, 1] - node_m[:, 1:]).max() < TOLERANCE_M
    faces = grid_triangles(U, W).astype(np.uint32).tobytes()
    assert faces in buffers
    assert capsys.readouterr().out == ""


def test_curves_alone_are_a_page_too_and_30_frames_a_second_are_enough(
    animation: Animation, tmp_path: Path
) -> None:
    path = tmp_path / "curves.html"
    quick = Animation(
        np.arange(FRAMES) / 120,
        animation.node_m,
        animation.q_world_node,
        animation.valid,
        animation.names,
        np.zeros((FRAMES, 0, 0, 3), np.float32),
    )
    export(quick, path, Options(up="y"))
    _, buffers = embedded(path)
    assert len([data for data in buffers if len(data) == RIBBONS * (NODES - 1) * 24]) == FRAMES // 4
