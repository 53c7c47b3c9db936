"""Only pages of this machine may connect to the page's server."""

from collections.abc import Iterator

import pytest
import viser
from ribbonhost.errors import RibbonError
from ribbonhost.view.serving import open_server
from websockets.asyncio import server as websockets_server
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    before = websockets_server.serve
    server = open_server("127.0.0.1", 18_080)
    assert websockets_server.serve is before, "others serve as they did"
    yield server.get_port()
    server.stop()


@pytest.mark.parametrize(
    "origin", ["http://127.0.0.1:{}", "http://localhost:{}", "http://localhost:9000", None]
)
def test_pages_of_this_machine_and_programs_connect(port: int, origin: str | None) -> None:
    said = Origin(origin.format(port)) if origin else None
    with connect(f"ws://127.0.0.1:{port}", origin=said, subprotocols=[PROTOCOL]) as page:
        assert page.recv(timeout=10)


@pytest.mark.parametrize(
    "origin", ["https://example.org", "http://example.org:{}", "http://localhost.example.org", "null"]
)
def test_pages_of_others_are_refused(port: int, origin: str) -> None:
    said = Origin(origin.format(port))
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{port}", origin=said, subprotocols=[PROTOCOL])


def test_a_viser_that_cannot_be_told_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    class Other:
        stopped = False

        def __init__(self, **options: object) -> None: ...

        def stop(self) -> None:
            Other.stopped = True

    monkeypatch.setattr(viser, "ViserServer", Other)
    with pytest.raises(RibbonError, match="refuse the pages of others"):
        open_server("127.0.0.1", 18_081)
    assert Other.stopped
