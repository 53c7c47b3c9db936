"""The whole path: sensors at register level, firmware, link, host, surface."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from ribbonhil.comb_spec import CombSpec
from ribbonhil.emulator import EmulatedComb
from ribbonhil.faults import LinkFaults
from ribbonhil.serve_command import comb_text

SECONDS = 2.0
RIBBONHOST = [sys.executable, "-c", "from ribbonhost.cli import main; main()"]
RIBBONHIL = [sys.executable, "-m", "ribbonhil"]
MY_SCENE = """
import numpy as np

PERIOD_S = 20.0

def height(x_m, y_m, t):
    return 0.05 * np.cos(2 * np.pi * (x_m / 0.9 + t)) * np.cos(2 * np.pi * y_m / 1.1)
"""


def streamed(*arguments: object, seconds: float = SECONDS, motion: str = "off") -> list[dict[str, Any]]:
    """The lines of `ribbonhost stream ... --json`, which must succeed and say nothing else."""
    done = subprocess.run(
        [
            *RIBBONHOST,
            "stream",
            *map(str, arguments),
            "--seconds",
            str(seconds),
            "--motion",
            motion,
            "--json",
        ],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return [json.loads(line) for line in done.stdout.splitlines()]


def check_nothing_is_lost(summary: dict[str, Any], seconds: float) -> None:
    """Of five ribbons and a reference at 100 Hz."""
    assert (summary["ribbons"], summary["rate_hz"]) == (6, 100)
    assert summary["frames"] >= 0.98 * 6 * 100 * seconds
    assert summary["surfaces"] >= 0.9 * 100 * seconds
    assert (summary["lost"], summary["crc_errors"], summary["invalid_nodes"]) == (0, 0, 0)


@pytest.mark.parametrize(("scene", "error_limit_percent"), [("wing", 0.25), ("breath", 0.25), ("sea", 0.5)])
def test_an_emulated_comb_streams_an_accurate_surface(scene: str, error_limit_percent: float) -> None:
    *reports, last = streamed("--emulate", scene, "--ribbons", 5, "--rate", 100)
    check_nothing_is_lost(last["summary"], SECONDS)
    error_percent = last["summary"]["error_percent"]
    assert 0 < error_percent["min"] <= error_percent["mean"] <= error_limit_percent
    assert [round(report["report"]["t_s"]) for report in reports] == [1, 2]
    assert all(ribbon["aligned"] for ribbon in reports[-1]["report"]["ribbons"])


def test_a_comb_in_motion_is_estimated_with_what_the_calibrations_say() -> None:
    """What it takes to keep up is a core of this computer: that of six ribbons, `make bench` tells."""
    *reports, last = streamed("--emulate", "wing", "--ribbons", 2, "--rate", 50, motion="live")
    assert all("note" not in report and "event" not in report for report in reports)
    for ribbon in reports[-1]["report"]["ribbons"]:
        assert ribbon["motion"]["estimated"] > 20
        assert ribbon["motion"]["restarts"] == 0
    # An estimate is of the end of its scan, however old the readings are by then.
    assert last["summary"]["age_ms"] == pytest.approx(last["summary"]["latency_ms"]["p50"], abs=0.5)
    assert last["summary"]["error_percent"]["mean"] < 0.15


def test_a_link_that_does_not_carry_readings_is_asked_for_less() -> None:
    *lines, last = streamed("emulated://wing/0?baud=115200", "--rate", 50, seconds=3, motion="live")
    told = [line["event"]["what"] for line in lines if "event" in line]
    assert len([what for what in told if "does not carry RAW beside ORIENT" in what]) == 1
    assert last["summary"]["frames"] > 30


def test_a_scene_of_ones_own_streams_as_the_built_in_ones(tmp_path: Path) -> None:
    scene = tmp_path / "my_scene.py"
    scene.write_text(MY_SCENE)
    summary = streamed("--emulate", scene, "--method", "hermite")[-1]["summary"]
    check_nothing_is_lost(summary, SECONDS)
    assert summary["error_percent"]["mean"] <= 0.5


def test_the_latency_is_that_of_a_scan_and_a_link() -> None:
    """That the clocks are compared rightly; how quick it is on an idle machine, `make bench` tells."""
    summary = streamed("--emulate", "wing", seconds=2)[-1]["summary"]
    assert 0 < summary["latency_ms"]["p50"] < 100
    assert summary["cpu_percent"] > 0


def test_a_scene_that_cannot_be_is_wrong_usage() -> None:
    done = subprocess.run([*RIBBONHOST, "stream", "--emulate", "none.py"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "none.py" in done.stderr
    assert done.stderr.count("\n") == 1


@contextmanager
def serving(comb_file: Path, *options: str) -> Iterator[list[str]]:
    """`ribbonhil serve` in another process; the command that it says to type."""
    process = subprocess.Popen(
        [*RIBBONHIL, "serve", "wing", "--ribbons", "2", "--comb", str(comb_file), *options],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout
        line = next(line for line in process.stdout if line.startswith("ribbonhost stream"))
        yield shlex.split(line)
    finally:
        process.terminate()
        process.communicate(timeout=20)


@pytest.mark.parametrize("options", [("--tcp", "--port", "0"), ("--pty",)])
def test_the_command_that_serve_prints_streams_what_is_served(
    tmp_path: Path, options: tuple[str, ...]
) -> None:
    with serving(tmp_path / "comb.toml", *options) as command:
        assert command[:2] == ["ribbonhost", "stream"]
        summary = streamed(*command[2:], seconds=2)[-1]["summary"]
        again = streamed(*command[2:], seconds=0.5)[-1]["summary"]
    assert (summary["ribbons"], summary["lost"], summary["crc_errors"]) == (3, 0, 0)
    assert summary["surfaces"] >= 0.7 * 100 * 2
    assert summary["error_percent"] is None
    assert again["ribbons"] == 3, "the ports were given back"


def test_a_noisy_link_and_a_pulled_cable_leave_the_other_ribbons_alone(tmp_path: Path) -> None:
    """And the cable is put back half a second later: the ribbon is back within two seconds from then."""
    spec = CombSpec(ribbons=3)
    faults = {1: LinkFaults(flip=2e-4, insert=1e-4), 3: LinkFaults(disconnect_s=3.5, reconnect_s=4.0)}
    comb_file = tmp_path / "comb.toml"
    with EmulatedComb(ribbons=3) as comb:
        comb_file.write_text(comb_text(comb))
    urls = [spec.url(index, faults.get(index, LinkFaults())) for index in range(4)]
    *lines, last = streamed(*urls, "--comb", comb_file, seconds=5)
    first, noisy, whole, pulled = lines[-1]["report"]["ribbons"]
    assert (first["lost"], first["crc_errors"], first["malformed"]) == (0, 0, 0)
    assert (whole["lost"], whole["crc_errors"], whole["malformed"]) == (0, 0, 0)
    assert noisy["crc_errors"] + noisy["malformed"] >= 5
    assert noisy["lost"] >= 5
    assert (pulled["state"], pulled["times_gone"], pulled["aligned"]) == ("streaming", 1, True)
    assert 0.3 < pulled["gone_s"] < 2.5
    told = [line["event"]["what"] for line in lines if "event" in line]
    assert any("vanished" in what for what in told)
    assert any("is back on emulated://" in what for what in told)
    assert last["summary"]["surfaces"] >= 0.7 * 100 * 5


def test_one_emulated_ribbon_says_who_it_is() -> None:
    done = subprocess.run(
        [*RIBBONHOST, "info", "emulated://wing/0"], capture_output=True, text=True, check=True
    )
    assert re.search(r"serial +[0-9a-f]{24}", done.stdout)
    assert "lis2dw12: 16, mmc5983ma: 16" in done.stdout
