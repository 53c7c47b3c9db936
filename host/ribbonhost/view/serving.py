"""Serves viser's page on this machine, to pages of this machine only."""

import threading
from typing import Any

import viser
import websockets.asyncio.server

from ribbonhost.errors import RibbonError
from ribbonhost.origins import ALLOWED

_ONE_AT_A_TIME = threading.Lock()


def open_server(host: str, port: int) -> viser.ViserServer:
    """A server on `port` or the next that is free, whose WebSocket refuses pages of other origins.

    viser does not say of itself which pages may connect, so the function of websockets that it serves with is
    told, while it opens. Raises RibbonError for a viser that serves in another way.
    """
    guarded = False
    serve = websockets.asyncio.server.serve

    def serve_local(*args: Any, **options: Any) -> Any:
        nonlocal guarded
        guarded = True
        return serve(*args, **(options | {"origins": ALLOWED}))

    with _ONE_AT_A_TIME:
        websockets.asyncio.server.serve = serve_local  # type: ignore[misc,assignment]
        try:
            server = viser.ViserServer(host=host, port=port, verbose=False)
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not guarded:
        server.stop()
        raise RibbonError(
            f"viser {viser.__version__} cannot be told to refuse the pages of others: "
            'type `pip install "viser==1.1.*"`'
        )
    return server
