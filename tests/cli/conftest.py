"""A command line without serial ports of its own, and scripted ribbons on TCP ports for it."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from host.command_line import Run, runner
from host.fake_ribbon import FakeRibbon, served
from serial.tools import list_ports


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `ribbonhost` with arguments in this process; returns its exit code, stdout and stderr."""
    monkeypatch.setattr(list_ports, "comports", list)
    monkeypatch.delenv("RIBBONHOST_PORTS", raising=False)
    return runner(monkeypatch, capsys)


@pytest.fixture
def fakes() -> list[FakeRibbon]:
    return [FakeRibbon(serial=serial) for serial in ("21d7" + "0" * 20, "21aa" + "0" * 20)]


@pytest.fixture
def urls(fakes: list[FakeRibbon]) -> Iterator[list[str]]:
    with ExitStack() as stack:
        yield [stack.enter_context(served(fake)) for fake in fakes]
