"""Where faults are made for a check: an emulator takes requests, and a person is asked."""

from __future__ import annotations

import contextlib
import io
import json
import math
import selectors
import socket
from collections.abc import Iterator

import pytest
from ribbonhil.check.provoke import HOLD_S, Injector, Person, comb_of, injector_of
from ribbonhil.fault_port import CLIENTS_MAX, REQUEST_BYTES, FaultClient, FaultPort
from ribbonhil.faults import BUS, FaultKind
from ribbonhost.errors import LinkError

GOOD = {"serial": "aa", "kind": "absent", "slot": 4, "seconds": 0.5}


class Port:
    """A fault port with one client, in one thread."""

    def __init__(self) -> None:
        self.made: list[tuple[str, FaultKind, int, float]] = []
        self.port = FaultPort(0, self._make)
        self.selector = selectors.DefaultSelector()
        self.port.attach(self.selector)
        host, _, number = self.port.address.rpartition(":")
        self.client = socket.create_connection((host, int(number)), timeout=5)

    def _make(self, serial: str, kind: FaultKind, slot: int, seconds: float) -> None:
        if serial != "aa":
            raise ValueError(f"there is no ribbon {serial} here")
        self.made.append((serial, kind, slot, seconds))

    def serve(self) -> None:
        while events := self.selector.select(0.05):
            for key, _ in events:
                key.data()

    def ask(self, line: bytes) -> dict[str, object]:
        self.client.sendall(line)
        self.serve()
        answer: dict[str, object] = json.loads(self.client.recv(4096))
        return answer

    def close(self) -> None:
        self.client.close()
        self.port.close()
        self.selector.close()


@pytest.fixture
def port() -> Iterator[Port]:
    port = Port()
    yield port
    port.close()


def test_request_is_carried_out_and_acknowledged(port: Port) -> None:
    assert port.ask(json.dumps(GOOD).encode() + b"\n") == {"ok": True}
    assert port.ask(json.dumps(GOOD | {"kind": "miso_high"}).encode() + b"\n") == {"ok": True}
    assert port.made == [("aa", FaultKind.ABSENT, 4, 0.5), ("aa", FaultKind.MISO_HIGH, BUS, 0.5)]


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{}",
        b"[1, 2]",
        b"\xff\x00",
        b"[" * 900,
        json.dumps(GOOD | {"kind": "none"}).encode(),
        json.dumps(GOOD | {"slot": 64}).encode(),
        json.dumps(GOOD | {"slot": -1}).encode(),
        json.dumps(GOOD | {"slot": math.inf}).encode(),
        json.dumps(GOOD | {"slot": 4.7}).encode(),
        json.dumps(GOOD | {"slot": True}).encode(),
        json.dumps(GOOD | {"seconds": 0}).encode(),
        json.dumps(GOOD | {"seconds": math.nan}).encode(),
        json.dumps(GOOD | {"seconds": 1e9}).encode(),
        json.dumps(GOOD | {"serial": "bb"}).encode(),
    ],
)
def test_wrong_request_is_refused_and_the_next_one_taken(port: Port, line: bytes) -> None:
    assert set(port.ask(line + b"\n")) == {"error"}
    assert port.made == []
    assert port.ask(json.dumps(GOOD).encode() + b"\n") == {"ok": True}


def test_line_without_end_is_hung_up_on(port: Port) -> None:
    port.client.sendall(b"x" * 3 * REQUEST_BYTES)
    port.serve()
    with contextlib.suppress(ConnectionResetError):  # what was sent and not read makes it so
        assert port.client.recv(100) == b""
    port.serve()


def test_only_programs_of_this_machine_reach_it_and_not_too_many(port: Port) -> None:
    host, _, number = port.port.address.rpartition(":")
    assert host == "127.0.0.1"
    port.serve()
    with contextlib.ExitStack() as stack:
        clients = [
            stack.enter_context(socket.create_connection((host, int(number)), timeout=5))
            for _ in range(CLIENTS_MAX)
        ]
        port.serve()
        assert clients[-1].recv(100) == b""
        assert port.ask(json.dumps(GOOD).encode() + b"\n") == {"ok": True}


@pytest.mark.parametrize(
    "answer", [b"", b"5\n", b"null\n", b"{}\n", b"[" * 3000 + b"\n", b'{"error": "no"}\n']
)
def test_answer_that_is_no_consent_is_an_error(answer: bytes) -> None:
    with contextlib.ExitStack() as stack:
        listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        client = stack.enter_context(FaultClient(f"127.0.0.1:{listener.getsockname()[1]}"))
        peer = stack.enter_context(listener.accept()[0])
        peer.sendall(answer)
        peer.shutdown(socket.SHUT_WR)
        with pytest.raises(LinkError):
            client.injector("aa")(FaultKind.ABSENT, 4, 0.5)


def test_injector_of_a_url_makes_faults_in_the_comb_of_the_url() -> None:
    url = "emulated://rest/1?ribbons=2&seed=99"
    with comb_of(url) as comb:
        injector = injector_of(url, comb)
        assert isinstance(injector, Injector)
        provocation = injector.provocations(32)[0]
        began_s = injector.start(provocation)
        assert began_s is not None
        assert began_s >= comb.start_host_s
        assert injector.stop(provocation) == pytest.approx(began_s + HOLD_S)


def test_person_is_asked_to_pull_a_wire_and_to_put_it_back(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    person = Person()
    (provocation,) = person.provocations(32)
    assert provocation.slots == tuple(range(32))
    assert person.start(provocation) is None
    person.stop(provocation)
    said = capsys.readouterr().err
    assert "Pull the wire of MISO" in said
    assert "press Enter" in said
