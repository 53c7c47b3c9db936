"""Bytes to and from one device, over anything that pyserial opens."""

import contextlib
import errno
import os
import platform
import select
import socket
import threading
import time
from collections.abc import Callable
from typing import Protocol
from urllib.parse import urlsplit

from ribbonhost.errors import LinkError, LinkLostError, UsageError

BAUD = 921_600
READ_BYTES = 4096
POLL_S = 0.1
"""How often a reader that hears nothing looks whether it shall stop."""

UNANSWERED_S = 3.0
"""A TCP connection whose bytes nobody acknowledges for so long is gone, where the system can say so."""

EMULATOR_SCHEME = "emulated://"


OnBytes = Callable[[bytes, float], None]
OnLost = Callable[[LinkLostError], None]


class Port(Protocol):
    """What a link needs of an open port; pyserial's ports have it."""

    @property
    def in_waiting(self) -> int: ...

    def read(self, size: int = 1, /) -> bytes: ...

    def write(self, data: bytes, /) -> int | None: ...

    def close(self) -> None: ...


class Link:
    """One open port and the thread that reads it.

    Attributes:
        name: what the user typed to open the port.
        baud: the speed that was asked for.
        bytes_read, bytes_written: since it was opened.
        lost: why the port can no longer be used; None while it can.
    """

    def __init__(self, port: Port, name: str, baud: int = BAUD) -> None:
        self.name = name
        self.baud = baud
        self.bytes_read = 0
        self.bytes_written = 0
        self.lost: LinkLostError | None = None
        self._port = port
        self._take = _reader_of(port)
        self._stopping = threading.Event()
        self._write_lock = threading.Lock()
        self._use_lock = threading.Lock()
        self._on_bytes: OnBytes = lambda data, t_host_s: None
        self._on_lost: OnLost = lambda error: None
        self._thread: threading.Thread | None = None

    def start(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Starts the reader thread.

        It calls on_bytes(bytes, t_host_s) with what arrived and when, never with nothing, and on_lost once
        if the port vanishes.
        """
        self._on_bytes, self._on_lost = on_bytes, on_lost
        self._thread = threading.Thread(target=self._read, name=f"read {self.name}", daemon=True)
        self._thread.start()

    def hand_over(self, prepare: Callable[[], None], on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Lets somebody else have what arrives, who gets ready in `prepare`, while nobody is given anything.

        Raises LinkLostError, with nothing done, if the port is gone.
        """
        with self._use_lock:
            if self.lost:
                raise self.lost
            prepare()
            self._on_bytes, self._on_lost = on_bytes, on_lost

    def write(self, data: bytes) -> None:
        """Sends all bytes. Any thread may call. Raises LinkLostError if the port is gone."""
        if self.lost:
            raise self.lost
        try:
            with self._write_lock:
                self._port.write(data)
        except (OSError, TypeError, ValueError) as error:
            raise LinkLostError(f"{self.name} does not take bytes any more: {_reason(error)}") from error
        self.bytes_written += len(data)

    def stop(self) -> None:
        """Tells the reader thread to end, without waiting for it."""
        self._stopping.set()

    def close(self) -> None:
        """Ends the reader thread and closes the port. Harmless when closed before."""
        self.stop()
        if self._thread and self._thread is not threading.current_thread():
            self._thread.join()
        connection = getattr(self._port, "_socket", None)
        if connection:
            connection.close()  # pyserial leaves one open that was reset by the other side
        with contextlib.suppress(OSError):  # a port that vanished cannot be closed
            self._port.close()

    def _read(self) -> None:
        while not self._stopping.is_set():
            try:
                data = self._take()
            # pyserial raises TypeError when its descriptor was closed meanwhile.
            except (OSError, EOFError, TypeError, ValueError) as error:
                with self._use_lock:
                    if not self._stopping.is_set():
                        self.lost = LinkLostError(f"{self.name} vanished: {_reason(error)}")
                        self._on_lost(self.lost)
                return
            if data:
                t_host_s = time.monotonic()
                self.bytes_read += len(data)
                with self._use_lock:
                    self._on_bytes(data, t_host_s)


def open_link(url: str, *, baud: int = BAUD) -> Link:
    """Opens a serial port by name, or any URL that pyserial knows, also emulated:// where ribbonhil is
    installed.

    Raises UsageError for something that is no port name, and LinkError, with what to do, if it cannot be
    opened.
    """
    import serial

    if url.startswith(EMULATOR_SCHEME):
        register_emulator()
    if url.startswith("socket://"):
        _check_socket_url(url)
    try:
        # exclusive: two programs on one port would each get half of the bytes.
        port = serial.serial_for_url(url, baudrate=baud, timeout=POLL_S, write_timeout=1.0, exclusive=True)
    except ValueError as error:
        raise UsageError(f"{url} is no port: {error}") from error
    except (OSError, AttributeError, TypeError) as error:
        raise LinkError(f"cannot open {url}: {_advice(url, error)}") from error
    if url.startswith("socket://"):
        _set_up_socket(port)
    return Link(port, url, baud)


def register_emulator() -> None:
    """Makes emulated:// known to pyserial. Raises LinkError if ribbonhil is not installed."""
    import importlib.util

    import serial

    if importlib.util.find_spec("ribbonhil") is None:
        raise LinkError(
            "emulated ribbons need ribbonhil, which is not installed: run `make setup`, or pip install ./hil"
        )
    if "ribbonhil.pyserial" not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append("ribbonhil.pyserial")


def ports_seen() -> list[str]:
    """Serial ports of this machine, with what they say about themselves."""
    from serial.tools import list_ports

    return sorted(
        f"{port.device} ({port.description})" if port.description not in (None, "n/a") else str(port.device)
        for port in list_ports.comports()
    )


def _reader_of(port: Port) -> Callable[[], bytes]:
    """A function that waits up to POLL_S for bytes and returns what is there, perhaps nothing.

    pyserial's own read() waits for a number of bytes and, on a socket, takes them one by one. So
    descriptors are read directly where that is possible. Raises OSError or EOFError when the port is gone.
    """
    try:
        # Windows has select() for sockets only.
        descriptor = port.fileno() if os.name == "posix" else None  # type: ignore[attr-defined]
    except (AttributeError, OSError, ValueError):
        descriptor = None
    if descriptor is None:

        def take() -> bytes:
            data = port.read(1)
            waiting = port.in_waiting if data else 0
            return data + port.read(waiting) if waiting else data

    else:

        def take() -> bytes:
            if not select.select([descriptor], [], [], POLL_S)[0]:
                return b""
            try:
                data = os.read(descriptor, READ_BYTES)
            except BlockingIOError:
                return b""
            if not data:
                raise EOFError("closed by the other side")
            return data

    return take


def _check_socket_url(url: str) -> None:
    try:
        parts = urlsplit(url)
        complete = bool(parts.hostname) and parts.port is not None
    except ValueError:
        complete = False
    if not complete:
        raise UsageError(f"{url} is no port: it must read socket://HOST:PORT")


def _set_up_socket(port: object) -> None:
    descriptor = os.dup(port.fileno())  # type: ignore[attr-defined]
    with socket.socket(fileno=descriptor) as connection:
        # Pings must not wait for more bytes to come along (Nagle's algorithm).
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            # A bridge that lost its power says nothing; TCP itself would notice after a quarter of an hour.
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1e3 * UNANSWERED_S))


def errno_of(error: BaseException) -> int | None:
    """The operating system's number of what is behind an error; None if there is none."""
    return getattr(_root(error), "errno", None)


def _root(error: BaseException) -> BaseException:
    """The operating system's own error, which pyserial wraps."""
    while not getattr(error, "errno", None) and (cause := error.__cause__ or error.__context__):
        error = cause
    return error


def _reason(error: BaseException) -> str:
    root = _root(error)
    number = getattr(root, "errno", None)
    if isinstance(number, int) and number in errno.errorcode:
        return os.strerror(number)
    return getattr(root, "strerror", None) or str(root) or type(root).__name__


def _advice(url: str, error: Exception) -> str:
    """Why a port cannot be opened and what to do about it."""
    number = getattr(_root(error), "errno", None)
    local = "://" not in url
    if local and number in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return f"there is no such port; seen: {', '.join(ports_seen()) or 'none'}"
    if local and number in (errno.EACCES, errno.EPERM):
        if platform.system() == "Linux":
            return f"no permission: type `sudo usermod -a -G {_group(url)} $USER`, then log out and in again"
        return "no permission, or another program uses it"
    if number in (errno.EBUSY, errno.EAGAIN):
        return "another program uses it: close that first"
    if number == errno.ECONNREFUSED:
        return "nothing listens there: start what serves it, or check host and port"
    return _reason(error)


def _group(path: str) -> str:
    """The group that may use a device file: dialout on Debian, uucp elsewhere."""
    import grp

    try:
        return grp.getgrgid(os.stat(path).st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"
