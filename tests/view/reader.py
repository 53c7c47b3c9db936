"""Stand-ins for browsers: take what the page's server sends as fast as they are told to, and show nothing."""

import threading
import time
from urllib.parse import urlsplit

import msgspec
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 0.8,
    "near": 0.1,
    "far": 10.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""With it a browser says that it is there."""


class Reader:
    """One that looks at a page.

    Attributes:
        windows: what came so far: a window holds all that is new since the one before.
        bytes_read: of them.
    """

    def __init__(self, url: str, *, pause_s: float = 0.0) -> None:
        """pause_s: between two windows; a browser that is slow."""
        self.windows = 0
        self.bytes_read = 0
        self._pause_s = pause_s
        self._socket = connect(
            f"ws://{urlsplit(url).netloc}",
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            max_size=None,
            compression=None,
            ping_interval=None,  # one that is slow answers late, and stays
        )
        self._socket.send(msgspec.msgpack.encode(CAMERA))
        threading.Thread(target=self._read, daemon=True).start()

    def close(self) -> None:
        self._socket.close()

    def _read(self) -> None:
        try:
            while True:
                self.bytes_read += len(self._socket.recv())
                self.windows += 1
                time.sleep(self._pause_s)
        except ConnectionClosed:
            pass
