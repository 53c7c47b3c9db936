"""Offers the ribbons of an emulated comb to other programs: a pseudo-terminal or a TCP port each."""

import contextlib
import os
import select
import selectors
import socket
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

from ribbonhost.errors import LinkError, UsageError

from ribbonhil.emulator import Line

CHUNK_BYTES = 65536
BACKLOG_BYTES = 16384  # about a second of ORIENT at 100 Hz
LOOK_S = 0.1  # how often pseudo-terminals are asked whether somebody has opened them


class Endpoint(Protocol):
    """Where a client finds one ribbon."""

    @property
    def url(self) -> str:
        """What the client opens."""

    @property
    def is_used(self) -> bool:
        """Whether a client is connected."""

    @property
    def bytes_dropped(self) -> int:
        """Bytes for a client that did not take them in time."""

    def attach(self, selector: selectors.BaseSelector) -> None:
        """Registers files to watch, each with a function to call when it is readable."""

    def send(self, data: bytes) -> None:
        """Passes bytes to the client; without one they are lost, as on a wire."""

    def look(self) -> None:
        """Notices clients that come and go without a word, and goes on with what they have not taken yet."""

    def close(self) -> None:
        """Gives everything back."""


class _Backlog:
    """Bytes that a client has not taken yet; a piece that does not fit is lost whole, as frames should be."""

    def __init__(self, write: Callable[[bytes], int]) -> None:
        self.dropped = 0
        self._write = write
        self._bytes = bytearray()

    def send(self, data: bytes = b"") -> None:
        """Adds bytes and passes on what the client takes now. Raises OSError if it takes none any more."""
        if len(self._bytes) + len(data) > BACKLOG_BYTES:
            self.dropped += len(data)
        else:
            self._bytes += data
        if self._bytes:
            with contextlib.suppress(BlockingIOError):
                del self._bytes[: self._write(bytes(self._bytes))]

    def clear(self) -> None:
        self._bytes.clear()


def listen(address: str, port: int) -> socket.socket:
    """A listening TCP socket that does not block. Raises UsageError if the port cannot be had."""
    try:
        listener = socket.create_server((address, port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UsageError(f"port {port} of {address} cannot be had: {reason}") from error
    listener.setblocking(False)
    return listener


class TcpEndpoint:
    """A listening TCP port that takes one client at a time."""

    def __init__(self, address: str, port: int, on_bytes: Callable[[bytes], None]) -> None:
        """Port 0 takes any free one. Raises UsageError if the port cannot be had."""
        self._listener = listen(address, port)
        self.url = f"socket://{address}:{self._listener.getsockname()[1]}"
        self._on_bytes = on_bytes
        self._client: socket.socket | None = None
        self._backlog = _Backlog(lambda data: self._client.send(data) if self._client else len(data))
        self._selector: selectors.BaseSelector | None = None

    @property
    def is_used(self) -> bool:
        return self._client is not None

    def attach(self, selector: selectors.BaseSelector) -> None:
        self._selector = selector
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    @property
    def bytes_dropped(self) -> int:
        return self._backlog.dropped

    def send(self, data: bytes) -> None:
        if self._client is not None:
            try:
                self._backlog.send(data)
            except OSError:
                self._drop_client()

    def look(self) -> None:
        self.send(b"")

    def close(self) -> None:
        self._drop_client()
        if self._selector is not None:
            self._selector.unregister(self._listener)
        self._listener.close()

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        if self._client is not None:
            client.close()  # as a serial port that is in use
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client
        if self._selector is not None:
            self._selector.register(client, selectors.EVENT_READ, self._receive)

    def _receive(self) -> None:
        if self._client is None:
            return
        try:
            data = self._client.recv(CHUNK_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._on_bytes(data)
        else:
            self._drop_client()

    def _drop_client(self) -> None:
        if self._client is not None:
            if self._selector is not None:
                self._selector.unregister(self._client)
            self._client.close()
            self._client = None
            self._backlog.clear()


class PtyEndpoint:
    """A pseudo-terminal: any program that opens serial ports can open it."""

    def __init__(self, on_bytes: Callable[[bytes], None]) -> None:
        """Raises UsageError where there are no pseudo-terminals."""
        try:
            import tty

            self._master, slave = os.openpty()
        except (ImportError, AttributeError, OSError) as error:
            raise UsageError(f"no pseudo-terminal can be had here ({error}): use --tcp") from error
        tty.setraw(slave)
        self.url = os.ttyname(slave)
        # From now on a hang-up tells that no client has it open.
        os.close(slave)
        os.set_blocking(self._master, False)
        self.is_used = False
        self._on_bytes = on_bytes
        self._backlog = _Backlog(lambda data: os.write(self._master, data))
        self._selector: selectors.BaseSelector | None = None
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)

    def attach(self, selector: selectors.BaseSelector) -> None:
        self._selector = selector

    @property
    def bytes_dropped(self) -> int:
        return self._backlog.dropped

    def send(self, data: bytes) -> None:
        self._notice_client()
        if self.is_used:
            with contextlib.suppress(OSError):  # it will be noticed as a hang-up
                self._backlog.send(data)

    def look(self) -> None:
        self.send(b"")

    def _notice_client(self) -> None:
        hung_up = any(event & select.POLLHUP for _, event in self._poll.poll(0))
        if self.is_used == (not hung_up) or self._selector is None:
            return
        self.is_used = not hung_up
        # A master that is hung up is always readable: watching it would spin.
        if self.is_used:
            self._selector.register(self._master, selectors.EVENT_READ, self._receive)
        else:
            self._selector.unregister(self._master)
            self._backlog.clear()

    def close(self) -> None:
        if self.is_used and self._selector is not None:
            self._selector.unregister(self._master)
        self.is_used = False
        os.close(self._master)

    def _receive(self) -> None:
        try:
            data = os.read(self._master, CHUNK_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._on_bytes(data)
        else:
            self._notice_client()


class Watched(Protocol):
    """Something else that is served beside the ribbons."""

    def attach(self, selector: selectors.BaseSelector) -> None:
        """Registers files to watch, each with a function to call when it is readable."""

    def close(self) -> None:
        """Gives everything back."""


def serve(
    lines: Iterable[Line],
    endpoints: Iterable[Endpoint],
    on_change: Callable[[int, bool, int], None],
    seconds: float | None = None,
    others: Sequence[Watched] = (),
) -> None:
    """Carries bytes between lines and endpoints, one each, until interrupted or for so many seconds.

    on_change(index, is_used, bytes_dropped) is called when a client comes, and when it goes and leaves bytes
    that it did not take in time. others: served beside the ribbons.
    """
    pairs = list(zip(lines, endpoints, strict=True))
    used = [False] * len(pairs)
    dropped = [0] * len(pairs)
    deadline_s = None if seconds is None else time.monotonic() + seconds
    wake_reader, wake_writer = socket.socketpair()
    wake_reader.setblocking(False)
    wake_writer.setblocking(False)

    def wake() -> None:
        with contextlib.suppress(BlockingIOError):  # full: it will wake anyway
            wake_writer.send(b"\0")

    with selectors.DefaultSelector() as selector, wake_reader, wake_writer:
        selector.register(wake_reader, selectors.EVENT_READ, lambda: wake_reader.recv(CHUNK_BYTES))
        for line, endpoint in pairs:
            endpoint.attach(selector)
            line.on_arrival = wake
        for other in others:
            other.attach(selector)
        try:
            while deadline_s is None or time.monotonic() < deadline_s:
                for key, _ in selector.select(LOOK_S):
                    key.data()
                for index, (line, endpoint) in enumerate(pairs):
                    if line.waiting:
                        endpoint.send(line.read(CHUNK_BYTES, 0.0))
                    else:
                        endpoint.look()
                    if endpoint.is_used != used[index]:
                        used[index] = endpoint.is_used
                        on_change(index, used[index], endpoint.bytes_dropped - dropped[index])
                        dropped[index] = endpoint.bytes_dropped
        finally:
            for line, endpoint in pairs:
                line.on_arrival = None
                endpoint.close()
            for other in others:
                other.close()


def to_line(line: Line) -> Callable[[bytes], None]:
    """A function that passes a client's bytes to the ribbon, which loses them if its link is gone."""

    def write(data: bytes) -> None:
        with contextlib.suppress(LinkError):
            line.write(data)

    return write
