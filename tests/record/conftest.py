"""Recordings for the tests: one of an emulated comb, made by command, and what made-up ones say."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from host.command_line import runner
from ribbonhost import wire
from ribbonhost.record import Header, RecordedRibbon

COMMAND = [sys.executable, "-c", "from ribbonhost.cli import main; main()"]
SERIALS = [f"{i:024x}" for i in range(1, 4)]
HEADER = Header(
    ribbons=tuple(RecordedRibbon(f"ribbon {i}", SERIALS[i], i, f"port {i}", 4, 0.025) for i in range(3)),
    comb="",
    rate_hz=100,
    method="spline",
    wall_offset_ns=0,
    host_version="0",
    wire_version=wire.WIRE_VERSION,
    schema_hash=wire.SCHEMA_HASH,
)


@dataclass(frozen=True)
class Done:
    """What a command printed and returned."""

    returncode: int
    stdout: str
    stderr: str


Command = Callable[..., Done]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs `ribbonhost` with arguments in this process."""
    run = runner(monkeypatch, capsys)
    return lambda *arguments: Done(*run(*arguments))


@pytest.fixture(scope="session")
def wing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four seconds of an emulated comb of three ribbons, as a user records them."""
    path = tmp_path_factory.mktemp("recordings") / "wing.mcap"
    arguments = ["record", path, "--emulate", "wing", "--ribbons", "2", "--seconds", "4", "--json"]
    subprocess.run([*COMMAND, *map(str, arguments)], check=True, capture_output=True, timeout=60)
    return path
