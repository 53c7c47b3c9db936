"""Links open anything that pyserial opens, and say clearly what is wrong if they cannot."""

import errno
import os
import queue
import socket
import threading
import time
from pathlib import Path

import pytest
import serial
from ribbonhost.errors import LinkError, LinkLostError, UsageError
from ribbonhost.link import Link, open_link


class Heard:
    """What a link's thread was told."""

    def __init__(self, link: Link) -> None:
        self.chunks: queue.Queue[bytes] = queue.Queue()
        self.lost: queue.Queue[LinkLostError] = queue.Queue()
        link.start(lambda data, _: self.chunks.put(data), self.lost.put)

    def bytes(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            data += self.chunks.get(timeout=5)
        return data


def test_bytes_pass_both_ways_over_tcp_and_come_in_one_piece() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link(f"socket://127.0.0.1:{server.getsockname()[1]}")
        connection, _ = server.accept()
        with connection:
            heard = Heard(link)
            connection.sendall(bytes(range(200)))
            assert heard.chunks.get(timeout=5) == bytes(range(200))
            link.write(b"ping")
            assert connection.recv(100) == b"ping"
            assert (link.bytes_read, link.bytes_written) == (200, 4)
            link.close()


def test_a_closed_connection_is_noticed_at_once() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link(f"socket://127.0.0.1:{server.getsockname()[1]}")
        connection, _ = server.accept()
        heard = Heard(link)
        connection.close()
        error = heard.lost.get(timeout=5)
        assert "vanished" in str(error)
        with pytest.raises(LinkLostError):
            link.write(b"more")
        link.close()


def test_a_serial_port_is_read_and_its_end_is_noticed() -> None:
    master, slave = os.openpty()
    link = open_link(os.ttyname(slave))
    os.close(slave)
    heard = Heard(link)
    os.write(master, b"\x01\x00\x13\x11\x0d")
    assert heard.bytes(5) == b"\x01\x00\x13\x11\x0d", "no byte means anything to the terminal driver"
    os.close(master)
    assert "vanished" in str(heard.lost.get(timeout=5))
    link.close()


def test_a_port_without_a_descriptor_is_read_too() -> None:
    link = Link(serial.serial_for_url("loop://", timeout=0.1), "loop://")
    heard = Heard(link)
    link.write(b"abcdefg")
    assert heard.bytes(7) == b"abcdefg"
    link.close()
    assert heard.lost.empty()


def test_closing_is_no_loss_and_ends_the_thread() -> None:
    before = threading.active_count()
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link(f"socket://127.0.0.1:{server.getsockname()[1]}")
        heard = Heard(link)
        link.close()
        link.close()
    assert heard.lost.empty()
    assert threading.active_count() == before


def test_what_a_port_cannot_be_is_said_with_what_to_do() -> None:
    with pytest.raises(LinkError, match=r"/dev/ttyNONE: there is no such port; seen: "):
        open_link("/dev/ttyNONE")
    with pytest.raises(LinkError, match="Inappropriate ioctl"):
        open_link("/dev/null")
    with pytest.raises(UsageError, match="protocol 'carrier' not known"):
        open_link("carrier://pigeon")
    for url in ("socket://", "socket://host", "socket://:99", "socket://host:port", "socket://[bad"):
        with pytest.raises(UsageError, match="must read socket://HOST:PORT"):
            open_link(url)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(LinkError, match="nothing listens there"):
        open_link(f"socket://127.0.0.1:{port}")


def test_a_port_that_another_program_uses_is_called_busy() -> None:
    master, slave = os.openpty()
    with serial.Serial(os.ttyname(slave), exclusive=True):
        start_s = time.monotonic()
        with pytest.raises(LinkError, match="another program uses it"):
            open_link(os.ttyname(slave))
        assert time.monotonic() - start_s < 5
    os.close(slave)
    os.close(master)


def test_a_port_without_permission_names_the_group_to_join(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    port = tmp_path / "ttyUSB7"
    port.touch()

    def refuse(*args: object, **options: object) -> None:
        raise serial.SerialException(errno.EACCES, f"could not open port {port}: Permission denied")

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    monkeypatch.setattr("platform.system", lambda: "Linux")
    with pytest.raises(LinkError, match=f"sudo usermod -a -G {port.group()} "):
        open_link(str(port))


def test_emulated_ribbons_without_the_emulator_say_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(LinkError, match="ribbonhil, which is not installed: run `make setup`"):
        open_link("emulated://wing/0")
