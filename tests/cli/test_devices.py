"""Ribbons are found among other ports, which are left in peace, and answer to their names."""

import errno
import fcntl
import json
import os
import pty
import resource
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial
from host.fake_ribbon import FakeRibbon
from ribbonhost import wire
from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.device.discovery import PortState, probe_ports
from ribbonhost.framing import Deframer

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def other_device() -> Iterator[tuple[int, str]]:
    """A serial device that is no ribbon: its own end, and the name of the port."""
    device, port = pty.openpty()
    tty.setraw(port)
    yield device, os.ttyname(port)
    os.close(device)
    os.close(port)


def test_ribbons_and_what_they_are_are_listed(run: Run, urls: list[str]) -> None:
    code, out, err = run("devices", *urls)
    assert (code, err) == (0, "")
    first = out.splitlines()[1].split()
    assert first[:6] == ["21d7" + "0" * 20, urls[0], "host", "0.1.0", str(wire.WIRE_VERSION), "8"]
    assert "4 lis2dw12, 4 mmc5983ma" in out
    assert "100 of 200 Hz" in out
    assert "\x1b" not in out


def test_json_tells_ribbons_from_other_ports(
    run: Run, urls: list[str], other_device: tuple[int, str]
) -> None:
    os.write(other_device[0], b"$GPGGA,hello\r\n")
    code, out, _ = run("devices", "--json", urls[1], other_device[1], "/dev/ttyNONE")
    found = json.loads(out)
    assert code == 0
    assert [(r["serial"], r["port"], r["slots_found"]) for r in found["ribbons"]] == [
        ("21aa" + "0" * 20, urls[1], 8)
    ]
    assert [(o["port"], o["state"]) for o in found["others"]] == [
        (other_device[1], "no ribbon"),
        ("/dev/ttyNONE", "not opened"),
    ]


def test_another_device_receives_one_get_info_and_nothing_else(other_device: tuple[int, str]) -> None:
    device, port = other_device
    assert probe_ports([port])[0].state is PortState.OTHER
    os.set_blocking(device, False)
    packets = [wire.decode(packet)[0] for packet in Deframer().feed(os.read(device, 4096))]
    assert [(type(p), p.command) for p in packets if isinstance(p, wire.Command)] == [
        (wire.Command, wire.CommandCode.GET_INFO)
    ]
    assert len(packets) == 1


def test_a_port_that_another_program_uses_is_said_to_be_busy(run: Run, other_device: tuple[int, str]) -> None:
    with open(other_device[1], "rb", buffering=0) as user:
        fcntl.flock(user, fcntl.LOCK_EX)
        code, out, _ = run("devices", other_device[1])
    assert code == 0
    assert "busy" in out
    assert "another program uses it" in out


def test_a_port_that_is_not_permitted_comes_with_the_command_to_type(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(url: str, **settings: Any) -> None:
        raise serial.SerialException(errno.EACCES, f"could not open port {url}: Permission denied")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    _, out, _ = run("devices", "/dev/ttyACM0")
    assert "not permitted" in out
    assert "sudo usermod -a -G" in out


def test_a_device_that_needs_a_later_host_is_incompatible(
    run: Run, urls: list[str], fakes: list[FakeRibbon]
) -> None:
    fakes[0].info_changes = {"wire_version": 9, "oldest_host_version": 9}
    _, out, _ = run("devices", urls[0])
    assert "incompatible" in out
    assert "install a later ribbonhost" in out


def test_no_ribbon_says_what_to_do(run: Run) -> None:
    code, out, _ = run("devices")
    assert code == 0
    assert "No ribbon was found on 0 ports: plug one in" in out


def test_a_port_that_takes_long_to_open_holds_nobody_up(monkeypatch: pytest.MonkeyPatch) -> None:
    enough = threading.Event()

    def open_slowly(url: str, **settings: Any) -> None:
        enough.wait(60)
        raise serial.SerialException("out of reach")

    monkeypatch.setattr(serial, "serial_for_url", open_slowly)
    start_s = time.monotonic()
    (port,) = probe_ports(["/dev/rfcomm0"])
    assert time.monotonic() - start_s < 20
    enough.set()
    assert port.state is PortState.FAILED
    assert "in time" in port.what


@pytest.mark.parametrize("name", ["21d7", "21D7" + "0" * 20])
def test_a_serial_number_or_its_start_names_a_ribbon(
    run: Run, urls: list[str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("RIBBONHOST_PORTS", " ".join(urls))
    code, out, err = run("info", name, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["info"]["serial"] == "21d7" + "0" * 20


def test_a_start_that_fits_two_ribbons_is_wrong_usage(
    run: Run, urls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIBBONHOST_PORTS", " ".join(urls))
    code, _, err = run("info", "21")
    assert code == 2
    assert "type more digits" in err


def test_a_serial_number_that_is_not_there_says_what_is(
    run: Run, urls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIBBONHOST_PORTS", urls[0])
    code, _, err = run("info", "77d0")
    assert code == 1
    assert f"no ribbon 77d0 was found; ribbons here: {'21d7' + '0' * 20} on {urls[0]}" in err


def test_a_name_of_the_comb_file_names_a_ribbon(
    run: Run, urls: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RIBBONHOST_PORTS", " ".join(urls))
    comb = Comb(
        "ab" * 12, 0.025, (CombRibbon("21d7" + "0" * 20, 0), CombRibbon("21aa" + "0" * 20, 0.1, "left"))
    )
    path = tmp_path / "comb.toml"
    path.write_text(comb.to_toml())
    code, out, _ = run("info", "left", "--comb", path, "--json")
    assert code == 0
    assert json.loads(out)["info"]["serial"] == "21aa" + "0" * 20


def test_stream_takes_names_and_refuses_two_for_one_ribbon(
    run: Run, urls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIBBONHOST_PORTS", urls[1])
    code, out, _ = run("stream", "21aa", "--seconds", "0.3", "--json")
    assert code == 0
    assert json.loads(out.splitlines()[-1])["summary"]["ribbons"] == 1
    monkeypatch.setenv("RIBBONHOST_PORTS", urls[0])
    code, _, err = run("stream", "21d7", urls[0])
    assert code == 2
    assert "are one ribbon" in err


def test_the_list_and_the_help_come_quickly() -> None:
    """Within 1 s and 0.3 s of CPU time: what others do on this machine stretches any other time."""
    program = [sys.executable, "-c", "from ribbonhost.cli import main; main()"]
    for arguments, limit_s in ((["devices"], 1.0), (["--help"], 0.3)):
        before_s = cpu_of_children_s()
        subprocess.run([*program, *arguments], check=True, capture_output=True)
        assert cpu_of_children_s() - before_s < limit_s, arguments


def cpu_of_children_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def test_devices_and_doctor_tell_of_the_ribbons_that_are_named(
    run: Run, urls: list[str], fakes: list[FakeRibbon], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIBBONHOST_PORTS", " ".join(urls))
    path = tmp_path / "comb.toml"
    comb = Comb(
        fakes[0].serial, 0.025, (CombRibbon(fakes[1].serial, 0.0, "left"), CombRibbon("ff" * 12, 0.1))
    )
    path.write_text(comb.to_toml())
    code, out, _ = run("devices", "left", "--comb", path, "--json")
    assert code == 0
    assert [(r["name"], r["port"]) for r in json.loads(out)["ribbons"]] == [("left", urls[1])]
    code, out, _ = run("devices", "--comb", path)
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()[:3]] == ["name", "reference", "left"]
    assert f"at 0.1 m ({'ff' * 12}) of {path} is not here." in out
    _, out, _ = run("doctor", "21aa", "--json")
    told = {check["name"] for check in json.loads(out)["checks"]}
    assert f"port {urls[1]}" in told
    assert f"port {urls[0]}" not in told
    monkeypatch.delenv("RIBBONHOST_PORTS")
    code, out, err = run("devices", "77")
    assert (code, out) == (1, "")
    assert "no ribbon 77 was found" in err
