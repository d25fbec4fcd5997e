"""Serves the page on a socket until the server's task is cancelled."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import uvicorn

from experiments.servers.feed import Feed
from experiments.servers.page.application import application
from experiments.servers.page.bounded import MOST_HEAD, BoundedHttp, BoundedWebSocket

MOST_INBOUND = 65_536
"""Largest number of bytes of a message from a client; a requirement."""
PING_S = 10.0
"""Interval of pings, and timeout of their answers [s]; choice: a lost client is dropped within twice this time."""
LEAVING_S = 1
"""Time in which clients can close their connections when the server ends [s]; choice."""


async def serve(sock: socket.socket, feed: Feed, *, hosts: Iterable[str], token: str, read_open: bool) -> None:
    """Serve a feed on a bound socket until cancelled, then close connections and socket; see `application`.

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
