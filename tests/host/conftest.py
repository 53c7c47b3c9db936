"""A machine without serial ports but those that a test gives it."""

from types import SimpleNamespace

import pytest
from serial.tools import list_ports


@pytest.fixture
def ports(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Serial ports of this machine, as a test has them."""
    names: list[str] = []
    monkeypatch.setattr(list_ports, "comports", lambda: [SimpleNamespace(device=name) for name in names])
    monkeypatch.delenv("RIBBONHOST_PORTS", raising=False)
    return names
