"""emulated:// URLs behave as serial ports do, with plain pyserial."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial
from ribbonhil import emulator
from ribbonhil.comb_spec import CombSpec, parse_url
from ribbonhil.emulator import EmulatedComb
from ribbonhil.faults import Fault, FaultKind, LinkFaults
from ribbonhost.errors import UsageError
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.wire import Command, CommandCode, Info, Orient, decode, encode

URL = "emulated://wing/1?ribbons=2&seed=4"


@pytest.fixture(autouse=True)
def _handler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial, "protocol_handler_packages", ["ribbonhil.pyserial"])


@pytest.fixture
def port() -> Iterator[serial.SerialBase]:
    with serial.serial_for_url(URL, baudrate=921600, timeout=5) as opened:
        yield opened


def packets(port: serial.SerialBase, seconds: float) -> list[object]:
    """What the port delivers in that time, decoded."""
    deframer, found, end_s = Deframer(), [], time.monotonic() + seconds
    port.timeout = 0.05
    while time.monotonic() < end_s:
        found += [decode(packet)[0] for packet in deframer.feed(port.read(port.in_waiting or 1))]
    assert deframer.crc_errors == 0
    return found


def test_device_answers_commands_and_streams_in_real_time(port: serial.SerialBase):
    port.write(encode_frame(encode(Command(tag=7, command=CommandCode.GET_INFO, argument=0, data=b""))))
    seen = packets(port, 1.5)
    info = [p for p in seen if isinstance(p, Info)]
    orient = [p for p in seen if isinstance(p, Orient)]
    assert len(info) >= 1
    assert 70 <= len(orient) <= 151  # 100 Hz, less the time that the sensors need to start
    assert np.diff([p.sequence for p in orient]).tolist() == [1] * (len(orient) - 1)


def test_first_packet_of_a_ribbon_that_starts_with_its_port_is_not_lost(monkeypatch: pytest.MonkeyPatch):
    """However late a busy machine gets to it: a ribbon says INFO 0.2 s after its start, and only once."""
    connect = emulator._World.connect

    def late(*arguments: Any) -> emulator.Line:
        time.sleep(0.5)
        return connect(*arguments)

    monkeypatch.setattr(emulator._World, "connect", late)
    with serial.serial_for_url(URL, timeout=5) as port:
        seen = packets(port, 0.6)
    assert isinstance(seen[0], Info)


def test_reading_ends_at_the_size_or_at_the_timeout(port: serial.SerialBase):
    assert len(port.read(100)) == 100
    port.timeout = 0.05
    start_s = time.monotonic()
    data = port.read(1_000_000)
    assert 0.04 <= time.monotonic() - start_s < 2
    assert len(data) < 100_000
    port.timeout = 0
    port.reset_input_buffer()
    assert len(port.read(1_000_000)) < 10_000


def test_in_waiting_counts_what_a_read_returns_at_once(port: serial.SerialBase):
    while port.in_waiting < 300:
        time.sleep(0.01)
    assert len(port.read(300)) == 300
    port.reset_input_buffer()
    assert port.in_waiting < 300


@pytest.mark.parametrize("wake", ["cancel_read", "close"])
def test_blocked_read_returns_when_cancelled_or_closed(port: serial.SerialBase, wake: str):
    port.timeout = None
    returned = threading.Event()

    def read() -> None:
        port.read(10_000_000)
        returned.set()

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    assert not returned.wait(0.2)
    getattr(port, wake)()
    assert returned.wait(2)
    reader.join()


def test_closed_port_refuses_everything(port: serial.SerialBase):
    port.close()
    port.close()
    assert not port.is_open
    for use in (lambda: port.read(1), lambda: port.write(b"x"), lambda: port.in_waiting, port.flush):
        with pytest.raises(serial.PortNotOpenError):
            use()


def test_a_ribbon_can_be_open_once_and_again_after_it_was_closed(port: serial.SerialBase):
    with pytest.raises(serial.SerialException, match="ribbon 1 of wing is open already"):
        serial.serial_for_url(URL)
    port.close()
    with serial.serial_for_url(URL, timeout=5) as again:
        assert len(again.read(50)) == 50


def test_ports_of_one_comb_share_it_until_the_last_is_closed():
    with EmulatedComb("wing", ribbons=2, seed=4) as comb:
        assert comb.urls[1] == URL
        with serial.serial_for_url(comb.urls[0], timeout=5), serial.serial_for_url(URL, timeout=5) as port:
            first_start_s = comb.start_host_s
            port.write(
                encode_frame(encode(Command(tag=1, command=CommandCode.GET_INFO, argument=0, data=b"")))
            )
            info = next(p for p in packets(port, 1.0) if isinstance(p, Info))
            assert bytes(info.unique_id).hex() == comb.serials[1]
    assert len(set(comb.serials)) == 3
    with EmulatedComb("wing", ribbons=2, seed=4) as again:
        assert again.start_host_s > first_start_s
        assert again.serials == comb.serials


def test_unplugged_ribbon_fails_and_can_be_opened_again_when_it_is_back():
    with EmulatedComb("wing", ribbons=2, seed=4) as comb, serial.serial_for_url(URL, timeout=5) as port:
        assert port.read(10)
        comb.plug(1, plugged=False)
        with pytest.raises(serial.SerialException, match="the device is gone"):
            port.read(1_000_000)
        with pytest.raises(serial.SerialException, match="the device is gone"):
            port.write(b"\0")
        with pytest.raises(serial.SerialException, match="ribbon 1 of wing is disconnected"):
            serial.serial_for_url(URL)
        comb.plug(1, plugged=True)
        with serial.serial_for_url(URL, timeout=5) as again:
            assert len(again.read(100)) == 100
        with pytest.raises(serial.SerialException, match="the device is gone"):
            port.read(1_000_000)


def test_disconnect_in_the_url_ends_a_read():
    with (
        serial.serial_for_url(f"{URL}&disconnect_s=0.3", timeout=None) as port,
        pytest.raises(serial.SerialException, match="the device is gone"),
    ):
        port.read(10_000_000)


def test_corrupting_link_spoils_frames_and_not_the_reader():
    deframer = Deframer()
    with serial.serial_for_url(f"{URL}&flip=0.002", timeout=0.1) as port:
        frames = 0
        for _ in range(15):
            frames += len(deframer.feed(port.read(4000)))
    assert frames > 20
    assert deframer.crc_errors + deframer.malformed > 5


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("emulated://wing", "after the scene comes a ribbon, 0 .reference. to 5, not ''"),
        ("emulated://wing/6", "after the scene comes a ribbon, 0 .reference. to 5, not '6'"),
        ("emulated:///1", "is not of the form emulated://SCENE/INDEX"),
        ("emulated://wing/1?ribons=5", "there is no option ribons; there are baud, "),
        ("emulated://wing/1?ribbons=five", "ribbons must be a whole number, not 'five'"),
        ("emulated://wing/1?ribbons=9", "an emulated comb has 1 to 6 ribbons"),
        ("emulated://wing/1?noise=nan", "noise must be a number, not 'nan'"),
        ("emulated://wing/1?loss=2", "loss = 2 is no probability"),
        ("emulated://wing/1?seed=-1", "seed = -1 is not between 0 and"),
        ("emulated://wing/1?period_s=0", "the period must be a number of seconds"),
        ("emulated://nowhere.py/1", r"there is no scene file nowhere\.py"),
        ("emulated://see/1", "there is no scene 'see'"),
    ],
)
def test_url_that_means_nothing_is_refused_in_one_sentence(url: str, message: str):
    with pytest.raises(ValueError, match=message):
        serial.serial_for_url(url)


def test_url_carries_the_parameters_and_back():
    spec = CombSpec("../my scenes/a.py", 3, 9, 2.5, 0.0, -10.0, 60.0, 50.0, 115200)
    faults = LinkFaults(loss=0.01, disconnect_s=4.0)
    address = parse_url(spec.url(2, faults))
    assert (address.comb, address.index, address.faults) == (spec, 2, faults)
    with pytest.raises(UsageError):
        parse_url("socket://127.0.0.1:80")


def test_scene_file_can_be_opened_by_its_encoded_path(tmp_path: Path):
    path = tmp_path / "my scene.py"
    path.write_text("PERIOD_S = 4\ndef height(x_m, y_m, t):\n    return 0.1 * x_m * y_m\n")
    with EmulatedComb(str(path), ribbons=2) as comb, serial.serial_for_url(comb.urls[2], timeout=5) as port:
        assert "my%20scene.py" in comb.urls[2]
        assert len(port.read(100)) == 100


def test_truth_starts_at_the_references_anchor_and_moves_in_real_time():
    with EmulatedComb("sea", ribbons=2, period_s=2.0) as comb:
        now_s = comb.start_host_s + np.array([0.0, 0.5, 2.0])
        node_m = comb.truth_node_m(now_s)
        assert node_m.shape == (3, 3, 16, 3)
        np.testing.assert_allclose(node_m[0], node_m[2], atol=1e-9)
        assert np.abs(node_m[1] - node_m[0]).max() > 0.01
        # Node 0 of the reference is 25 mm of ribbon away from its anchor.
        assert np.linalg.norm(node_m[:, 0, 0], axis=-1) == pytest.approx([0.025] * 3, abs=1e-3)


def test_faults_and_counters_of_a_running_comb_can_be_reached():
    with EmulatedComb("wing", ribbons=1, seed=2) as comb:
        comb.add_fault(1, Fault(FaultKind.ABSENT, 4))
        time.sleep(0.3)
        counters = comb.counters(1)
        assert counters.bytes > 1000
        assert counters.conflicts == 0
        assert np.isnan(counters.first_conflict_s)
        assert counters.samples[4] == 0
        assert counters.samples[6] > 0
