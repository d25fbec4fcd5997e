"""A server on a free port of the loopback, and clients of it."""

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import wraps
from typing import Any

from experiments.servers.feed import Feed
from experiments.servers.openigtlink.codec import HEADER, Message, decode, decode_header
from experiments.servers.openigtlink.server import serve
from tests.experiments.servers.openigtlink.states import SCENE, state
from tests.experiments.waiting import SOON_S

NEVER_STALE = 3_600_000
"""In place of 200 ms where staleness is not the point: a busy machine takes long."""


def awaited(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    """A test that is a coroutine, which must not take for ever."""

    @wraps(test)
    def run(*args: Any, **keys: Any) -> None:
        asyncio.run(asyncio.wait_for(test(*args, **keys), 5.0 * SOON_S))

    return run


async def until(holds: Callable[[], object]) -> None:
    """Wait for what comes soon."""
    async with asyncio.timeout(SOON_S):
        while not holds():
            await asyncio.sleep(0.01)


@contextlib.asynccontextmanager
async def serving(feed: Feed, **options: Any) -> AsyncIterator[int]:
    """The port of a server of this feed; afterwards it is cancelled, and has closed its socket."""
    sock = socket.create_server(("127.0.0.1", 0))
    port = sock.getsockname()[1]
    task = asyncio.create_task(serve(sock, feed, **options))
    try:
        await asyncio.sleep(0)
        yield port
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            async with asyncio.timeout(SOON_S):
                await task
        assert sock.fileno() == -1


def feed_of(**scene: Any) -> tuple[Feed, list[dict[str, Any]]]:
    """A feed of the scene with these keys, and the list of commands that come back through it."""
    commands: list[dict[str, Any]] = []
    return Feed(SCENE | {"stale_ms": NEVER_STALE} | scene, commands.append), commands


@contextlib.asynccontextmanager
async def served_client(**scene: Any) -> AsyncIterator[tuple[Feed, list[dict[str, Any]], "Client"]]:
    """A feed of the scene with these keys, commands that come back, and a client that has the body's message."""
    feed, commands = feed_of(**scene)
    async with serving(feed) as port, connected(port) as client:
        await client.next()
        yield feed, commands, client


def publish(feed: Feed, **other: Any) -> None:
    """A new moment."""
    feed.publish(json.dumps(state(**other)).encode(), None)


class Client:
    """One connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    async def next(self) -> Message:
        """The next message."""
        async with asyncio.timeout(SOON_S):
            header = decode_header(await self.reader.readexactly(HEADER.size))
            return decode(header, await self.reader.readexactly(header.size))

    async def until(self, device: str) -> Message:
        """The next message of this device."""
        while (message := await self.next()).device != device:
            pass
        return message

    async def is_dropped(self) -> bool:
        """Whether the server closes the connection soon; what it sent before is read away."""
        with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
            async with asyncio.timeout(SOON_S):
                while await self.reader.read(65536):
                    pass
        return True


@contextlib.asynccontextmanager
async def connected(port: int) -> AsyncIterator[Client]:
    """A client."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        yield Client(reader, writer)
    finally:
        writer.close()
        with contextlib.suppress(OSError):
            await writer.wait_closed()


def with_little_room(port: int) -> socket.socket:
    """A client whose system holds little that it has not read."""
    found = socket.socket()
    found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    found.connect(("127.0.0.1", port))
    found.setblocking(False)
    return found


async def drained(client: socket.socket) -> int:
    """How many bytes come until its connection ends, which is soon."""
    n_bytes = 0
    async with asyncio.timeout(SOON_S):
        with contextlib.suppress(ConnectionResetError):
            while piece := await asyncio.get_running_loop().sock_recv(client, 65536):
                n_bytes += len(piece)
    return n_bytes
