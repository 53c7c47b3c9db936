"""Faults on request: where `ribbonhil serve --faults` takes them, and who asks for them.

Both ends send lines of JSON over TCP: {"serial": "...", "kind": "absent", "slot": 4, "seconds": 0.8} is
answered by {"ok": true}, the fault being there from now on, or by {"error": "why not"}.
"""

from __future__ import annotations

import contextlib
import json
import math
import selectors
import socket
import time
from collections.abc import Callable
from typing import Any, Self

from ribbonhost.errors import LinkError, UsageError
from ribbonhost.wire import SLOT_MAX

from ribbonhil.faults import BUS, FaultKind
from ribbonhil.serve import listen

ADDRESS = "127.0.0.1"
"""Whoever can make faults can spoil a measurement: programs of this machine only."""
REQUEST_BYTES = 1000
ANSWER_BYTES = 4000
CLIENTS_MAX = 16
SECONDS_MAX = 60.0
TIMEOUT_S = 5.0
WHOLE_STRING = (FaultKind.MISO_LOW, FaultKind.MISO_HIGH)

Make = Callable[[str, FaultKind, int, float], None]


class FaultPort:
    """A TCP port of this machine that takes requests from up to CLIENTS_MAX clients; more are hung up on."""

    def __init__(self, port: int, make: Make) -> None:
        """make(serial, kind, slot, seconds) makes a fault, and raises ValueError for one that it cannot make.

        Port 0 takes any free one. Raises UsageError if the port cannot be had.
        """
        self._listener = listen(ADDRESS, port)
        self.address = f"{ADDRESS}:{self._listener.getsockname()[1]}"
        self._make = make
        self._clients: dict[socket.socket, bytearray] = {}
        self._selector: selectors.BaseSelector | None = None

    def attach(self, selector: selectors.BaseSelector) -> None:
        """Registers files to watch, each with a function to call when it is readable."""
        self._selector = selector
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def close(self) -> None:
        """Gives everything back."""
        for client in list(self._clients):
            self._drop(client)
        if self._selector is not None:
            self._selector.unregister(self._listener)
        self._listener.close()

    def _accept(self) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:  # it hung up again meanwhile
            return
        if len(self._clients) >= CLIENTS_MAX:
            client.close()
            return
        client.setblocking(False)
        self._clients[client] = bytearray()
        if self._selector is not None:
            self._selector.register(client, selectors.EVENT_READ, lambda: self._receive(client))

    def _receive(self, client: socket.socket) -> None:
        pending = self._clients[client]
        try:
            data = client.recv(REQUEST_BYTES)
            pending += data
            while b"\n" in pending:
                line, _, rest = bytes(pending).partition(b"\n")
                pending[:] = rest
                client.send(json.dumps(self._answer(line)).encode() + b"\n")
        except OSError:
            data = b""
        if not data or len(pending) > REQUEST_BYTES:
            self._drop(client)

    def _answer(self, line: bytes) -> dict[str, object]:
        try:
            self._make(*_request(line))
        except ValueError as error:
            return {"error": str(error)}
        return {"ok": True}

    def _drop(self, client: socket.socket) -> None:
        del self._clients[client]
        if self._selector is not None:
            self._selector.unregister(client)
        client.close()


def _request(line: bytes) -> tuple[str, FaultKind, int, float]:
    """Serial number, kind, slot and duration. Raises ValueError for a line that is no request."""
    try:
        wanted: Any = json.loads(line)
        serial, kind = str(wanted["serial"]), FaultKind[str(wanted["kind"]).upper()]
        slot, seconds = wanted["slot"], float(wanted["seconds"])
    except (ValueError, TypeError, LookupError, RecursionError, OverflowError) as error:
        raise ValueError(f"no request for a fault: {type(error).__name__}") from error
    if not (math.isfinite(seconds) and 0.0 < seconds <= SECONDS_MAX):
        raise ValueError(f"a fault lasts up to {SECONDS_MAX:g} s, not {seconds:g}")
    if type(slot) is not int or not 0 <= slot < SLOT_MAX:
        raise ValueError(f"slot must be a whole number below {SLOT_MAX}")
    return serial, kind, BUS if kind in WHOLE_STRING else slot, seconds


def _reason(answer: Any) -> str:
    """Why a request was refused, as far as the answer says."""
    return str(answer["error"]) if isinstance(answer, dict) and "error" in answer else f"it answers {answer}"


class FaultClient:
    """The other end: asks for faults."""

    def __init__(self, address: str) -> None:
        """Raises UsageError for an address that is none, LinkError if nobody listens there."""
        host, _, port = address.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
            raise UsageError(f"--faults {address} is not of the form HOST:PORT")
        try:
            self._socket = socket.create_connection((host, int(port)), timeout=TIMEOUT_S)
        except OSError as error:
            raise LinkError(
                f"nobody takes faults at {address} ({error.strerror or error}): "
                "`ribbonhil serve --faults PORT` would"
            ) from error
        self._address = address
        self._lines = self._socket.makefile("rb")

    def injector(self, serial: str) -> Callable[[FaultKind, int, float], float]:
        """inject(kind, slot, seconds) for a ribbon: makes a fault now, returns when it is over.

        On the clock of time.monotonic(). Raises LinkError if it is refused or nobody answers.
        """

        def inject(kind: FaultKind, slot: int, duration_s: float) -> float:
            request = {"serial": serial, "kind": kind.name.lower(), "slot": slot, "seconds": duration_s}
            if kind in WHOLE_STRING:
                request["slot"] = 0
            try:
                self._socket.sendall(json.dumps(request).encode() + b"\n")
                answer = json.loads(self._lines.readline(ANSWER_BYTES))
            except (OSError, ValueError, RecursionError) as error:
                raise LinkError(f"{self._address} does not answer when asked for a fault: {error}") from error
            if answer != {"ok": True}:
                raise LinkError(f"{self._address} makes no fault: {_reason(answer)}")
            return time.monotonic() + duration_s

        return inject

    def close(self) -> None:
        """Hangs up."""
        with contextlib.suppress(OSError):
            self._lines.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
