"""What the shell offers when Tab is pressed; no port is opened for it."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from cli.conftest import Run
from host.fake_ribbon import FakeRibbon
from ribbonhost.comb import Comb, CombRibbon
from serial.tools import list_ports

Offer = Callable[[str], list[str]]


@pytest.fixture
def offered(run: Run, monkeypatch: pytest.MonkeyPatch) -> Offer:
    """What is offered, in bash, after these words, the last of which is incomplete."""

    def offered(line: str) -> list[str]:
        monkeypatch.setenv("_RIBBONHOST_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
        return run()[1].split()

    return offered


def test_commands_options_scenes_and_targets_are_offered(offered: Offer) -> None:
    assert {"stream", "record", "finalise", "devices"} <= set(offered("ribbonhost "))
    assert offered("ribbonhost re") == ["record", "recover", "replay"]
    assert offered("ribbonhost stream --emu") == ["--emulate"]
    assert offered("ribbonhost stream --emulate w") == ["wing"]
    assert offered("ribbonhost record x.mcap --out os") == ["osc://127.0.0.1:9000"]


def test_ports_names_and_serial_numbers_are_offered_and_no_port_is_opened(
    offered: Offer, fakes: list[FakeRibbon], urls: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    port = SimpleNamespace(device="/dev/ttyACM3", description="ribbon")
    monkeypatch.setattr(list_ports, "comports", lambda: [port])
    monkeypatch.setenv("RIBBONHOST_PORTS", urls[0])
    assert offered("ribbonhost info ") == ["/dev/ttyACM3", urls[0]]
    assert offered("ribbonhost doctor /d") == ["/dev/ttyACM3"]
    comb = Comb(
        fakes[0].serial, 0.025, (CombRibbon(fakes[1].serial, 0.0, "left"), CombRibbon("ff" * 12, 0.1))
    )
    path = tmp_path / "comb.toml"
    path.write_text(comb.to_toml())
    assert offered(f"ribbonhost stream --comb {path} l") == ["left"]
    assert offered(f"ribbonhost stream --comb {path} 21") == [fakes[0].serial, fakes[1].serial]
    assert offered("ribbonhost stream --comb none.toml /dev") == ["/dev/ttyACM3"]
    assert [fake.commands for fake in fakes] == [[], []]
