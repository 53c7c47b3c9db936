"""The benchmark: its commands, and the figures that must hold wherever it runs."""

import json
from pathlib import Path

import numpy as np
import pytest
from ribbonhost.bench import chain, speed
from ribbonhost.bench.accuracy import DATA, measure_accuracy, solve
from ribbonhost.bench.budget import quantised, sources
from ribbonhost.bench.cli import app
from ribbonhost.bench.tables import accuracy_tables
from ribbonhost.errors import UsageError
from typer.testing import CliRunner

SCENE = """
import numpy as np

PERIOD_S = 3.0


def height(x_m, y_m, t):
    return 0.05 * np.sin(4 * x_m + 2 * np.pi * t) * np.cos(3 * y_m)
"""


def test_figures_of_the_wing_hold() -> None:
    """Limits of E in percent: noise free, with the parts' noise, smoothed; seams; coverage."""
    result = measure_accuracy(("wing",), 8, 0)
    wing = result["scenes"]["wing"]
    errors = {kind: wing["error_percent"][kind]["spline"]["mean"] for kind in result["data"]}
    assert errors["exact"] < 0.001
    assert errors["noise_free"] < 0.01
    assert errors["noise_at_rest"] < 0.5 * errors["noise"] < 0.05
    assert errors["noise_smoothed"] < 0.05
    assert errors["motion"] < 0.1
    assert errors["motion_smoothed"] < 0.05
    assert wing["error_percent"]["exact"]["hermite"]["mean"] > 10 * errors["exact"]
    assert wing["surface"]["measured"]["mean_mm"] < wing["surface"]["zero"]["mean_mm"] < 0.1
    assert wing["surface"]["measured"]["seam_deg"] < 1e-6
    assert 93 < wing["coverage"]["percent"] < 97
    assert 93 < result["coverage_straight"]["percent"] < 97
    assert "motion_smoothed" in accuracy_tables(result)


def test_steep_sea_is_followed_from_sensors_that_sit_apart() -> None:
    """E in percent, each frame held still, no noise: the limit, and more than exact orientations leave."""
    lines = chain.trace(chain.load("sea"), 24)
    exact = chain.exact(chain.load("sea"), lines)
    apart = solve(chain.at_rest(lines, 0.0, 0), "spline").percent.mean()
    assert 1.5 * solve(exact, "spline").percent.mean() < apart < 0.08


def test_accuracy_of_a_scene_file_as_json(tmp_path: Path) -> None:
    scene = tmp_path / "dunes.py"
    scene.write_text(SCENE)
    done = CliRunner().invoke(app, ["accuracy", "--json", "--frames", "4", "--scene", str(scene)])
    assert done.exit_code == 0, done.output
    figures = json.loads(done.stdout)["scenes"][str(scene)]["error_percent"]
    assert set(figures) == set(DATA)
    assert figures["noise"]["spline"]["mean"] < 0.7 * figures["motion"]["spline"]["mean"], "a period of 3 s"
    for by_method in figures.values():
        for e in by_method.values():
            assert 0 < e["min"] <= e["mean"] <= e["max"] < 5


def test_unknown_scene_is_a_wrong_usage() -> None:
    with pytest.raises(UsageError, match="nowhere"):
        chain.load("nowhere")


def test_quantisation_is_what_the_wire_leaves() -> None:
    """Worst turn over 2,000 orientations: 0.0075 and 0.26 degrees."""
    rng = np.random.default_rng(81)
    q = rng.normal(size=(125, 16, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    for compact, limit_deg in ((False, 0.0075), (True, 0.26)):
        same = np.abs(np.einsum("fki,fki->fk", q, quantised(q, compact)))
        worst = np.degrees(2 * np.arccos(np.minimum(same, 1))).max()
        assert limit_deg / 3 < worst <= limit_deg


def test_pairing_sensors_as_if_in_one_place_costs_most() -> None:
    found = sources(chain.load("wing"), 0)
    naive = found.pop("offset, sensors paired as if in one place")
    assert naive > 1
    assert all(0 < percent < 0.1 for percent in found.values())


def test_speed_as_json(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every figure is there; ratios with a margin of ten for a machine that does other things."""
    fastest = speed.fastest_s
    monkeypatch.setattr(speed, "fastest_s", lambda work, seconds=0.0, *clock: fastest(work, 0.0, *clock))
    monkeypatch.setattr(speed, "BATCH_FRAMES", 2000)
    done = CliRunner().invoke(app, ["speed", "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["slsqp_over_hermite"] > 1000
    assert found["spline_over_hermite"] < 60
    assert found["comb_frame_s"]["ratio"] > 30
    assert found["batch"]["spline"]["ratio"] > 0
    assert list(found["growth"]["nodes"]) == ["16", "32", "64", "128", "256", "512", "1024"]
    assert list(found["growth"]["ribbons_of_16_nodes"])[-1] == "64"
    assert CliRunner().invoke(app, ["speed"]).exit_code == 0
