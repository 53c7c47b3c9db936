"""`ribbonhil serve` and `ribbonhil truth` as commands, used by plain clients."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import serial
from ribbonhil.scenes import BUILTIN
from ribbonhil.truth import comb_truth
from ribbonhost.comb import load_comb
from ribbonhost.framing import Deframer
from ribbonhost.wire import Orient, decode
from scipy.spatial.transform import Rotation


def command(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ribbonhil", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
    )


@contextmanager
def served(folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """A running `ribbonhil serve` of three ribbons, and the URLs in the line that it says to type."""
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "ribbonhil", "serve", "wing", "--ribbons", "2", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        line = next((text for text in process.stdout if text.startswith("ribbonhost stream")), None)
        assert line is not None, process.communicate()
        assert line.split()[2:4] == ["--comb", "comb.toml"]
        yield process, line.split()[4:]
    finally:
        process.kill()
        process.communicate()


def orient_packets(port: serial.SerialBase, count: int) -> list[Orient]:
    deframer, found = Deframer(), []
    end_s = time.monotonic() + 10
    while len(found) < count and time.monotonic() < end_s:
        packets = [decode(packet)[0] for packet in deframer.feed(port.read(port.in_waiting or 1))]
        found += [packet for packet in packets if isinstance(packet, Orient)]
    return found


@pytest.mark.parametrize("kind", [("--pty",), ("--tcp", "--port", "0")], ids=["pty", "tcp"])
def test_each_ribbon_can_be_opened_streams_and_can_be_opened_again(tmp_path: Path, kind: tuple[str, ...]):
    with served(tmp_path, *kind) as (process, urls):
        assert len(urls) == 3
        assert all(re.fullmatch(r"/dev/\S+|socket://127\.0\.0\.1:\d+", url) for url in urls)
        ports = [serial.serial_for_url(url, baudrate=921600, timeout=0.2) for url in urls]
        for port in ports:
            assert len(orient_packets(port, 30)) == 30
        ports[1].close()
        time.sleep(0.3)
        with serial.serial_for_url(urls[1], baudrate=921600, timeout=0.2) as again:
            found = orient_packets(again, 30)
        assert np.diff([packet.sequence for packet in found]).min() >= 1
        for port in ports:
            port.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""


def test_a_second_tcp_client_is_turned_away_and_the_first_goes_on(tmp_path: Path):
    with (
        served(tmp_path, "--tcp", "--port", "0") as (_, urls),
        serial.serial_for_url(urls[0], timeout=0.2) as first,
        serial.serial_for_url(urls[0], timeout=2) as other,
    ):
        with pytest.raises(serial.SerialException):
            other.read(10)
        assert len(orient_packets(first, 20)) == 20


def test_bytes_that_a_client_does_not_take_are_counted_and_shown(tmp_path: Path):
    with served(tmp_path, "--pty", "--rate", "200") as (process, urls):
        idle = os.open(urls[1], os.O_RDWR | os.O_NOCTTY)
        time.sleep(3.0)  # 74 KB; terminal and backlog hold less
        os.close(idle)
        assert process.stdout is not None
        said = next(line for line in process.stdout if line.startswith("ribbon 1: disconnected"))
    assert re.search(r"; [1-9]\d* bytes were lost", said)


def test_comb_file_describes_the_served_comb(tmp_path: Path):
    with served(tmp_path, "--pty", "--seed", "3"):
        comb = load_comb(tmp_path / "comb.toml")
    assert comb.pitch_m == 0.025
    assert [ribbon.start_m for ribbon in comb.ribbons] == pytest.approx([0.0, 0.15])
    assert len({*comb.serials}) == 3


def test_rate_is_that_of_the_command_line(tmp_path: Path):
    with (
        served(tmp_path, "--pty", "--rate", "20") as (_, urls),
        serial.serial_for_url(urls[2], baudrate=921600, timeout=0.2) as port,
    ):
        found = orient_packets(port, 12)
    assert np.diff([packet.t_us for packet in found]).mean() == pytest.approx(50_000, rel=0.02)


def test_foreign_comb_file_is_not_overwritten(tmp_path: Path):
    (tmp_path / "comb.toml").write_text("mine\n")
    result = command("serve", "wing", "--seconds", "0.2", folder=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert "comb.toml is there already" in result.stderr
    assert (tmp_path / "comb.toml").read_text() == "mine\n"
    for _ in range(2):  # its own it replaces
        assert (
            command("serve", "wing", "--seconds", "0.2", "--comb", "own.toml", folder=tmp_path).returncode
            == 0
        )


def test_port_in_use_is_one_sentence(tmp_path: Path):
    with served(tmp_path, "--tcp", "--port", "0") as (_, urls):
        taken = urls[0].rpartition(":")[2]
        result = command("serve", "wing", "--tcp", "--port", taken, "--comb", "b.toml", folder=tmp_path)
    assert result.returncode == 2
    assert re.fullmatch(rf"ribbonhil: port {taken} of 127\.0\.0\.1 cannot be had: .+\n", result.stderr)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("serve", "see"), "there is no scene 'see'"),
        (("truth", "wing", "--ribbons", "9", "-o", "t.npz"), "Invalid value for '--ribbons'"),
        (("truth", "broken.py", "-o", "t.npz"), "broken.py does not define height"),
        (("truth", "wing", "--seconds", "100000", "-o", "t.npz"), "too many for one file"),
        (("nothing",), "No such command"),
    ],
)
def test_wrong_usage_exits_with_2_and_one_sentence(tmp_path: Path, arguments: tuple[str, ...], message: str):
    (tmp_path / "broken.py").write_text("PERIOD_S = 3\n")
    result = command(*arguments, folder=tmp_path)
    assert result.returncode == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "t.npz").exists()


def test_truth_file_holds_positions_and_orientations_of_all_sensors(tmp_path: Path):
    result = command(
        "truth", "breath", "--ribbons", "3", "--rate", "10", "--seconds", "2", "-o", "t.npz", folder=tmp_path
    )
    assert result.returncode == 0, result.stderr
    with np.load(tmp_path / "t.npz") as file:
        content = dict(file)
    truth = comb_truth(BUILTIN["breath"], 3)
    np.testing.assert_allclose(content["t_s"], np.arange(20) / 10)
    assert content["slot_position_m"].shape == (20, 4, 32, 3)
    np.testing.assert_allclose(content["slot_position_m"], truth.slot_m(content["t_s"]))
    np.testing.assert_array_equal(content["node_position_m"], content["slot_position_m"][:, :, 1::2])
    assert content["q_world_node"].shape == (20, 4, 16, 4)
    tangent = Rotation.from_quat(content["q_world_slot"][5, 2][:, [1, 2, 3, 0]]).as_matrix()[:, :, 0]
    chord = np.gradient(content["slot_position_m"][5, 2], 0.025, axis=0)
    np.testing.assert_allclose(tangent[1:-1], chord[1:-1], atol=0.01)
    np.testing.assert_allclose(content["node_s_m"], (2 * np.arange(16) + 1) * 0.025)
    assert set(content) == set(json.loads(str(content["units"])))


def test_truth_file_is_not_overwritten_unless_forced(tmp_path: Path):
    arguments = ("truth", "wing", "--ribbons", "2", "--seconds", "0.1", "-o", "t.npz")
    (tmp_path / "t.npz").write_text("mine")
    result = command(*arguments, folder=tmp_path)
    assert result.returncode == 2
    assert "t.npz is there already" in result.stderr
    assert (tmp_path / "t.npz").read_text() == "mine"
    assert command(*arguments, "--force", folder=tmp_path).returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.npz"]
    missing = command(*arguments[:-1], "no/such/folder/t.npz", folder=tmp_path)
    assert missing.returncode == 1
    assert "no/such/folder/t.npz cannot be written" in missing.stderr
