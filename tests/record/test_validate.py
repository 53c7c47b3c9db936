"""A recording and the truth of it are brought together, whatever the file that holds the truth."""

import json
import re
from pathlib import Path

import c3d
import numpy as np
import pytest
from numpy.typing import NDArray
from record.conftest import Command
from record.virtual import START_S, stream_virtually
from ribbonhil.scenes import load_scene
from ribbonhil.truth import Field, comb_truth
from ribbonhil.truth_file import write_truth
from ribbonhost.errors import ValidationError
from ribbonhost.record import Recording
from ribbonhost.validate.truth import read_truth
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

OFFSET_S = 0.037
ROTATION = Rotation.from_rotvec(np.radians([10.0, -25.0, 40.0]))
TRANSLATION_M = np.array([1.0, -2.0, 0.5])
NAMES = ("reference", "at 0 m", "at 0.15 m")
RATE_HZ = 120.0
LEVEL_LAG_S = 0.008
"""Acceleration tilts the level reading, which looks like 5.6 ms on the wing."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("validate") / "a.mcap"
    with pytest.MonkeyPatch.context() as monkeypatch:
        stream_virtually(path, monkeypatch, seconds=4.0)
    return path


@pytest.fixture(scope="module")
def truth(recording: Path) -> tuple[Array, Array]:
    """Seconds of a clock that is OFFSET_S ahead of the recording's, and turned and shifted positions."""
    t_s = np.arange(-0.4, 5.0, 1 / RATE_HZ)
    true_s = t_s - OFFSET_S + Recording(recording).t_zero_s - START_S
    node_m = comb_truth(load_scene("wing", None), 2, Field()).node_from_anchor_m(true_s)
    return t_s - t_s[0], node_m @ ROTATION.as_matrix().T + TRANSLATION_M


def write_csv(path: Path, t_s: Array, node_m: Array) -> None:
    with path.open("w") as file:
        file.write("t_s,ribbon,node,x_m,y_m,z_m\n")
        for t, ribbons in zip(t_s, node_m, strict=True):
            for name, nodes in zip(NAMES, ribbons, strict=True):
                for k, (x, y, z) in enumerate(nodes):
                    file.write(f"{t},{name},{k},{x},{y},{z}\n")


def test_offset_and_rotation_are_found_and_the_report_needs_nothing_else(
    recording: Path, truth: tuple[Array, Array], command: Command, tmp_path: Path
) -> None:
    np.savez(tmp_path / "truth.npz", t_s=truth[0], node_position_m=truth[1])
    page = tmp_path / "report.html"
    done = command("validate", recording, "--truth", tmp_path / "truth.npz", "--report", page, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["validation"]
    # A clock without OFFSET_S, to tell it from what the level reading adds.
    np.savez(tmp_path / "plain.npz", t_s=truth[0] - OFFSET_S, node_position_m=truth[1])
    plain = json.loads(command("validate", recording, "--truth", tmp_path / "plain.npz", "--json").stdout)[
        "validation"
    ]
    assert found["offset_s"] - plain["offset_s"] == pytest.approx(OFFSET_S, abs=1e-3)
    # The truth's clock starts 0.4 s before the recording's second 0.
    assert found["offset_s"] == pytest.approx(0.4 + OFFSET_S, abs=LEVEL_LAG_S)
    turn = Rotation.from_matrix(found["rotation"]) * ROTATION.inv()
    assert np.degrees(turn.magnitude()) < 0.05
    assert 0 < found["error_percent"]["min"] <= found["error_percent"]["mean"] < 0.1
    assert found["error_percent"]["mean"] <= found["error_percent"]["max"] < 0.5
    assert np.shape(found["node_mean_m"]) == (3, 16)
    text = page.read_text()
    assert re.findall(r'(?:src|href)="(?!data:)', text) == []
    assert text.count("data:image/png;base64,") == 2
    for picture in found["files"][1:]:
        assert Path(picture).read_bytes().startswith(b"\x89PNG")


def test_what_the_emulator_writes_is_taken_as_it_is(
    recording: Path, command: Command, tmp_path: Path
) -> None:
    path = tmp_path / "truth.npz"
    write_truth(
        path, "wing", comb_truth(load_scene("wing", None), 2, Field()), Field(), 100, 8, replace=False
    )
    done = command("validate", recording, "--truth", path, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["validation"]
    assert found["offset_s"] == pytest.approx(Recording(recording).t_zero_s - START_S, abs=LEVEL_LAG_S)
    assert found["rotation_deg"] < 0.05


@pytest.mark.filterwarnings("ignore::UserWarning")  # the library misses analog channels
def test_csv_npz_and_c3d_of_another_library_read_the_same(truth: tuple[Array, Array], tmp_path: Path) -> None:
    t_s, node_m = truth[0][:50], truth[1][:50].copy()
    node_m[10:20, 1, 3] = np.nan
    write_csv(tmp_path / "a.csv", t_s, node_m)
    np.savez(tmp_path / "a.npz", t_s=t_s, node_m=node_m)
    writer = c3d.Writer(point_rate=RATE_HZ, point_units="mm ", gen_scale=-1.0)
    labels = [f"R{r}N{k}" for r in range(3) for k in range(16)]
    writer.set_point_labels([*labels, "floor"])
    frames = []
    for positions in node_m.reshape(len(t_s), -1, 3):
        points = np.zeros((len(labels) + 1, 5), np.float32)
        points[:-1, :3] = 1000 * np.nan_to_num(positions)
        points[:-1, 3] = np.where(np.isfinite(positions[:, 0]), 0, -1)
        frames.append((points, np.empty((0, 0))))
    writer.add_frames(frames)
    with (tmp_path / "a.c3d").open("wb") as file:
        writer.write(file)
    from_csv, from_npz, from_c3d = (
        read_truth(tmp_path / f"a.{end}", NAMES, 16) for end in ("csv", "npz", "c3d")
    )
    np.testing.assert_array_equal(from_csv.node_m, from_npz.node_m)
    np.testing.assert_array_equal(from_csv.t_s, from_npz.t_s)
    np.testing.assert_allclose(from_c3d.node_m, from_csv.node_m, atol=1e-6)
    np.testing.assert_allclose(from_c3d.t_s, from_csv.t_s, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "t,x\n1,2\n", 'its first line names no column "t_s"'),
        ("a.csv", "t_s,ribbon,node,x_m,y_m,z_m\n0,5,0,1,2,3\n", 'line 2 is of ribbon "5"'),
        ("a.csv", "t_s,ribbon,node,x_m,y_m,z_m\n0,1,16,1,2,3\n", "line 2 is of node 16"),
        ("a.csv", "t_s,ribbon,node,x_m,y_m,z_m\n0,1,0,1,2,u\n", "line 2 holds no numbers"),
        ("a.csv", "t_s,ribbon,node,x_m,y_m,z_m\n0,1,0,1,2,3\n", "at least 4 are needed"),
        ("a.npz", "hello", "it is no NPZ file"),
        ("a.c3d", "hello", "it is no C3D file"),
        ("a.txt", "", "the ending must be one of"),
    ],
)
def test_a_truth_that_cannot_be_used_is_named(tmp_path: Path, name: str, content: str, message: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ValidationError, match=re.escape(message)) as caught:
        read_truth(path, NAMES, 16)
    assert "\n" not in str(caught.value)


def test_a_missing_truth_is_a_failure_in_a_sentence(
    recording: Path, command: Command, tmp_path: Path
) -> None:
    done = command("validate", recording, "--truth", tmp_path / "none.c3d")
    assert (done.returncode, done.stdout) == (1, "")
    assert "cannot be read: No such file" in done.stderr
