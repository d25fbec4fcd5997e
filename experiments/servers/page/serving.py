"""The page as an application of files, the schema and a WebSocket, served until the server's task is cancelled."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute

from experiments.servers.feed import Feed
from experiments.servers.page.access import Access, Guard
from experiments.servers.page.bounded import MOST_HEAD, BoundedHttp, BoundedWebSocket
from experiments.servers.page.stream import Stream

MOST_INBOUND = 65_536
"""Largest number of bytes of a message from a client; a requirement."""
PING_S = 10.0
"""Interval of pings, and timeout of their answers [s]; choice: a lost client is dropped within twice this time."""
LEAVING_S = 1
"""Time in which clients can close their connections when the server ends [s]; choice."""


STATIC = Path(__file__).parent / "static"
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/schema+json",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}


def application(feed: Feed, *, hosts: Iterable[str], token: str, read_open: bool) -> Starlette:
    """The page at `/`, its files beside it, and the stream at `/stream`, for clients as in `Access`."""
    access = Access(frozenset(host.lower() for host in hosts), token, read_open)
    # all files are in memory, so that paths in requests never reach the disk
    files = {path.relative_to(STATIC).as_posix(): path for path in sorted(STATIC.rglob("*")) if path.suffix in KINDS}
    held = {name: (path.read_bytes(), KINDS[path.suffix]) for name, path in files.items()}

    async def file(request: Request) -> Response:
        content, kind = held.get(request.path_params["name"] or "index.html", (None, ""))
        if content is None:
            return PlainTextResponse("not found\n", 404)
        return Response(content, media_type=kind)

    return Starlette(
        routes=[WebSocketRoute("/stream", Stream(feed, access).serve), Route("/{name:path}", file)],
        middleware=[Middleware(Guard, access=access)],
    )


async def serve(sock: socket.socket, feed: Feed, *, hosts: Iterable[str], token: str, read_open: bool) -> None:
    """Serve a feed on a bound socket until cancelled, then close connections and socket; clients: as in `Access`.

    The process itself handles signals.
    """
    config = uvicorn.Config(
        application(feed, hosts=hosts, token=token, read_open=read_open),
        http=BoundedHttp,
        ws=BoundedWebSocket,
        ws_max_size=MOST_INBOUND,
        ws_ping_interval=PING_S,
        ws_ping_timeout=PING_S,
        ws_per_message_deflate=False,
        h11_max_incomplete_event_size=MOST_HEAD,
        timeout_graceful_shutdown=LEAVING_S,
        lifespan="off",
        log_config=None,
        log_level="error",  # errors of hostile clients should not fill a log
        access_log=False,
        proxy_headers=False,
        server_header=False,
    )
    server = _Server(config)
    running = asyncio.create_task(server.serve(sockets=[sock]))
    try:
        await asyncio.shield(running)
    finally:
        server.should_exit = True
        await running
        for connection in list(server.server_state.connections):
            connection.transport.abort()


class _Server(uvicorn.Server):
    """uvicorn without its signal handlers."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture no signals."""
        yield
