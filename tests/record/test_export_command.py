"""What is exported from a recording is what was reconstructed."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pxr import Usd, UsdGeom
from record.conftest import Command
from record.virtual import stream_virtually
from ribbonhost.export.animation import surface_grid
from ribbonhost.pipeline.solving import Solved

TOLERANCE_M = 1e-6


@pytest.fixture(scope="module")
def streamed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Solved]]:
    path = tmp_path_factory.mktemp("streamed") / "a.mcap"
    with pytest.MonkeyPatch.context() as monkeypatch:
        return path, stream_virtually(path, monkeypatch, seconds=1.5)


def at(solved: list[Solved], t_s: np.ndarray) -> list[Solved]:
    """The frames that were reconstructed at these seconds after the first of them."""
    times = np.array([frame.match.t_host_s for frame in solved])
    nearest = np.abs(times[:, None] - (times[0] + t_s - t_s[0])).argmin(axis=0)
    return [solved[index] for index in nearest]


def test_positions_and_surface_agree_with_the_stream(
    streamed: tuple[Path, list[Solved]], command: Command, tmp_path: Path
) -> None:
    path, solved = streamed
    done = command("export", path, "-o", tmp_path / "a.npz", "--json")
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)["exported"]
    with np.load(tmp_path / "a.npz") as arrays:
        data = dict(arrays)
    assert facts["frames"] == len(data["t_s"]) >= 145
    assert list(data["names"]) == ["reference", "at 0 m", "at 0.15 m"]
    frames = at(solved[-len(data["t_s"]) :], data["t_s"])
    np.testing.assert_allclose(data["node_m"], [frame.node_m for frame in frames], atol=TOLERANCE_M)
    grids = [surface_grid(frame.comb.vertices_m) for frame in frames if frame.comb]
    np.testing.assert_allclose(data["surface_m"], grids, atol=TOLERANCE_M)


def test_a_part_at_a_lower_rate_in_another_frame_and_unit(
    streamed: tuple[Path, list[Solved]], command: Command, tmp_path: Path
) -> None:
    path, _ = streamed
    part = ("--from", 0.4, "--to", 1.2, "--rate", 20)
    done = command("export", path, "-o", tmp_path / "a.csv", *part, "--up", "y", "--scale", 100)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "a.csv")
    t_s = table.t_s.unique()
    assert t_s[0] >= 0.4
    assert t_s[-1] <= 1.2
    np.testing.assert_allclose(np.diff(t_s), 0.05, atol=0.011)
    assert command("export", path, "-o", tmp_path / "b.csv", *part).returncode == 0
    plain = pd.read_csv(tmp_path / "b.csv")
    np.testing.assert_allclose(table.y_m, 100 * plain.z_m, atol=1e-6)
    np.testing.assert_allclose(table.z_m, -100 * plain.y_m, atol=1e-6)


def test_a_stage_that_usd_opens(
    streamed: tuple[Path, list[Solved]], command: Command, tmp_path: Path
) -> None:
    path, _ = streamed
    assert command("export", path, "-o", tmp_path / "a.usdc", "--rate", 30).returncode == 0
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/ribbons/surface"))
    assert len(mesh.GetPointsAttr().GetTimeSamples()) == pytest.approx(46, abs=2)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["-o", "a.doc"], 2, "the ending must be one of"),
        (["-o", "a.csv", "--up", "x"], 2, "--up x is not z or y"),
        (["-o", "a.csv", "--from", "900"], 2, "no frame lies between"),
        (["-o", "a.csv", "--from", "2", "--to", "1"], 2, "is before"),
        (["-o", "none/a.csv"], 2, "no folder"),
    ],
)
def test_what_cannot_be_exported_is_a_sentence(
    streamed: tuple[Path, list[Solved]], command: Command, arguments: list[str], code: int, message: str
) -> None:
    done = command("export", streamed[0], *arguments)
    assert (done.returncode, done.stdout) == (code, "")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_file_that_is_there_is_kept_unless_told(
    streamed: tuple[Path, list[Solved]], command: Command, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("precious")
    assert command("export", streamed[0], "-o", path).returncode == 2
    assert path.read_text() == "precious"
    assert command("export", streamed[0], "-o", path, "--force").returncode == 0
