"""A WebSocket or TCP port at which any number of programs can listen."""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Awaitable, Callable, Coroutine

from ribbonhost.errors import MissingExtraError, RibbonError
from ribbonhost.origins import ALLOWED
from ribbonhost.out import message
from ribbonhost.out.feed import Feed
from ribbonhost.pipeline.solving import Solved

LISTENER_FRAMES = 32
"""Frames that may wait for one listener; of further ones it misses the oldest."""

SEND_BYTES = 1 << 16


class ServerFeed(Feed):
    """Serves from an event loop in a thread of its own."""

    def __init__(self, target: str, kind: str, host: str, port: int, facts: message.Facts) -> None:
        """kind: ws or tcp; port 0 takes any free one. Raises RibbonError, MissingExtraError."""
        super().__init__(target)
        self._hello = message.hello(facts)
        self._listeners: set[asyncio.Queue[str]] = set()
        self._shut: Callable[[], Coroutine[None, None, None]]
        self._loop = asyncio.new_event_loop()
        opening = self._open_ws(host, port) if kind == "ws" else self._open_tcp(host, port)
        try:
            self.port = self._loop.run_until_complete(opening)
            self.target = f"{kind}://{host}:{self.port}"
            self.note = "" if port else f"listen at {self.target}"
        except BaseException as error:
            self._loop.close()
            if isinstance(error, OSError):
                reason = error.strerror or str(error)
                raise RibbonError(f"--out {target}: the port cannot be had: {reason}") from error
            raise
        self._serving = threading.Thread(target=self._loop.run_forever, name=f"serve {target}", daemon=True)

    @property
    def listeners(self) -> int:
        """How many listen now."""
        return len(self._listeners)

    def start(self) -> None:
        """Begins to serve."""
        self._serving.start()
        super().start()

    def close(self) -> None:
        """Ends it; listeners are told that the connection closes."""
        if self._loop.is_closed():
            return
        super().close()
        if self._serving.is_alive():
            asyncio.run_coroutine_threadsafe(self._shut(), self._loop).result()
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._serving.join()
        else:
            self._loop.run_until_complete(self._shut())
        self._loop.close()

    def _send(self, number: int, solved: Solved) -> None:
        if self._listeners:
            self._loop.call_soon_threadsafe(self._tell, message.frame(number, solved))

    def _tell(self, text: str) -> None:
        for waiting in self._listeners:
            if waiting.full():
                waiting.get_nowait()
                self._missed += 1
            waiting.put_nowait(text)

    async def _listen(self, send: Callable[[str], Awaitable[None]]) -> None:
        """Sends one listener all that comes, until it goes."""
        waiting: asyncio.Queue[str] = asyncio.Queue(LISTENER_FRAMES)
        await send(self._hello)
        self._listeners.add(waiting)
        try:
            while True:
                await send(await waiting.get())
        finally:
            self._listeners.discard(waiting)

    async def _open_ws(self, host: str, port: int) -> int:
        try:
            from websockets.asyncio.server import ServerConnection, serve
            from websockets.exceptions import ConnectionClosed
        except ImportError as error:
            raise MissingExtraError("--out ws://", "websockets", "out") from error

        async def listen(connection: ServerConnection) -> None:
            _keep_fresh(connection.transport)
            sending = asyncio.ensure_future(self._listen(connection.send))
            with contextlib.suppress(ConnectionClosed):
                async for _ in connection:  # what listeners say means nothing; that they go does
                    pass
            sending.cancel()
            with contextlib.suppress(ConnectionClosed, asyncio.CancelledError):
                await sending

        server = await serve(listen, host, port, origins=ALLOWED, compression=None, max_size=1024)

        async def shut() -> None:
            server.close()
            await server.wait_closed()

        self._shut = shut
        return int(next(iter(server.sockets)).getsockname()[1])

    async def _open_tcp(self, host: str, port: int) -> int:
        tasks: set[asyncio.Task[None]] = set()

        async def listen(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            async def send(text: str) -> None:
                writer.write(text.encode() + b"\n")
                await writer.drain()

            task = asyncio.current_task()
            assert task is not None
            tasks.add(task)
            _keep_fresh(writer.transport)
            sending = asyncio.ensure_future(self._listen(send))
            try:
                while await reader.read(1024):
                    pass
            except (ConnectionError, asyncio.CancelledError):
                pass
            sending.cancel()
            with contextlib.suppress(ConnectionError, asyncio.CancelledError):
                await sending
            writer.close()
            tasks.discard(task)

        server = await asyncio.start_server(listen, host, port)

        async def shut() -> None:
            server.close()
            for task in tuple(tasks):
                task.cancel()
            await asyncio.gather(*tuple(tasks), return_exceptions=True)

        self._shut = shut
        return int(server.sockets[0].getsockname()[1])


def _keep_fresh(transport: asyncio.BaseTransport) -> None:
    """What waits inside the system is old when it arrives: a listener that is slow had better miss it."""
    assert isinstance(transport, asyncio.WriteTransport)
    transport.set_write_buffer_limits(0)
    transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES)
