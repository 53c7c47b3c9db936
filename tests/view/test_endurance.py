"""View, recording and stream together: nothing is lost, nothing grows, a slow browser holds up nobody.

RIBBON_SOAK_VIEW_S=600 makes it ten minutes long, and then it asserts what only a long run shows.
"""

import os
import re
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from ribbonhost.pipeline.replay import Replay
from ribbonhost.record import Recording
from view.commands import COMMAND, Running, running
from view.reader import Reader

SECONDS = float(os.environ.get("RIBBON_SOAK_VIEW_S", "8"))
IS_SOAK = SECONDS >= 300
MOTION = () if IS_SOAK else ("--motion", "off")
WARM_UP_S = 60.0 if IS_SOAK else 2.0
GROWTH_MAX_MIB = 5.0 if IS_SOAK else 40.0
"""A short run only shows gross growth: caches and pools still fill."""

CORE_MAX_PERCENT = 15.0


def resident_mib(pid: int) -> float:
    """Memory of a process."""
    match = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    assert match
    return int(match[1]) / 1024


def memory_over_time(command: Running, seconds: float) -> list[float]:
    """About once a second, after the warm-up."""
    begun_s = time.monotonic()
    found = []
    while (elapsed_s := time.monotonic() - begun_s) < seconds:
        time.sleep(1.0)
        if elapsed_s > WARM_UP_S:
            found.append(resident_mib(command.process.pid))
    return found


def test_view_and_recording_lose_nothing_and_do_not_grow(tmp_path: Path) -> None:
    file = tmp_path / "long.mcap"
    with running(tmp_path, "stream", "--emulate", "wing", "--record", file, *MOTION) as command:
        quick, slow = Reader(command.url), Reader(command.url, pause_s=1.0)
        command.wait_for("report")
        memory_mib = memory_over_time(command, SECONDS)
        windows = quick.windows, slow.windows
        quick.close()
        slow.close()
        lines = command.stop()
    (summary,) = [line["summary"] for line in lines if "summary" in line]
    (recorded,) = [line["recording"] for line in lines if "recording" in line]
    (note,) = [line["note"] for line in lines if "of a core" in line.get("note", "")]
    share_percent = float(re.findall(r"([\d.]+) % of a core", note)[0])
    low, high = min(memory_mib), max(memory_mib)
    print(
        f"\n{SECONDS:.0f} s, {summary['frames']} frames, {summary['lost']} lost, "
        f"p99 {summary['latency_ms']['p99']:.1f} ms; view {share_percent:.1f} % of a core, all "
        f"{summary['cpu_percent']:.0f} %; {windows[0] / SECONDS:.0f} windows a second to a quick browser, "
        f"{windows[1] / SECONDS:.1f} to a slow one; memory {memory_mib[0]:.1f} MiB, then "
        f"{low:.1f} to {high:.1f}, last {memory_mib[-1]:.1f}; {recorded['bytes'] / 2**20:.1f} MiB recorded"
    )
    assert summary["lost"] == 0
    assert summary["crc_errors"] == 0
    assert recorded["given_up"] == 0
    assert recorded["ended"] is None
    assert windows[0] > 3 * SECONDS
    assert 0 < windows[1] < 2 * SECONDS
    assert memory_mib[-1] - memory_mib[0] < GROWTH_MAX_MIB
    if IS_SOAK:
        assert share_percent < CORE_MAX_PERCENT

    frames: list[float] = []
    keep = [lambda solved: frames.append(solved.match.t_host_s)]
    replay = Replay([Recording(file)], motion="off", on_solved=keep)
    for _ in replay.play():
        pass
    report = replay.report()
    assert sum(ribbon.counters.lost for ribbon in report.ribbons) == 0
    assert report.comb.surfaces >= summary["surfaces"] * 0.95
    assert max(np.diff(frames)) < 0.5


@pytest.mark.parametrize("option", ["--view-port", "--speed"])
def test_options_of_the_page_say_what_they_need(option: str, tmp_path: Path) -> None:
    arguments = {
        "--view-port": (["stream", "--emulate", "wing", "--view-port", "8080"], "--view-port is for a page"),
        "--speed": (["replay", "no.mcap", "--view", "--speed", "0"], "--speed 0 shows nothing"),
    }[option]
    done = subprocess.run([*COMMAND, *arguments[0]], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert arguments[1] in done.stderr
