"""uvicorn's protocols with what they lack against hostile clients: every connection has bounded memory and an end.

`python -m tests.experiments.servers.page.fuzz` tries them by the hundred thousand.
"""

from __future__ import annotations

import asyncio
import re
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

MOST_CONNECTIONS = 64
"""Connections of all kinds at a time: 16 clients, and as many again that each fetch the page over three; chosen."""
REQUESTS_S = 20.0
"""Age at which a connection ends that is no WebSocket [s]: a page is fetched in less; chosen."""
CLOSING_S = 2.0
"""Time that a client has to take what is left for it once its connection is to end [s]; chosen."""
MOST_UNSENT = 8 * 2**20
"""Bytes that may wait for a client that goes on sending: more than the largest picture; chosen."""
MOST_HEAD = 16_384
"""Bytes of a request's line and headers; chosen: ours have 1000."""
MOST_PIECES = 256
"""Frames in one message: empty ones count nothing against its size; chosen."""


END_OF_HEAD = re.compile(rb"\n\r?\n")
"""What h11 takes for it."""


class BoundedHttp(H11Protocol):
    """HTTP; refuses connections beyond MOST_CONNECTIONS and heads beyond MOST_HEAD, ends each after REQUESTS_S."""

    _end: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection, or end it at once."""
        crowded = len(self.connections) >= MOST_CONNECTIONS
        super().connection_made(transport)
        if crowded:
            transport.abort()
        else:
            self._end = self.loop.call_later(REQUESTS_S, transport.abort)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._forget_end()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Answer what came, unless its head is too long: h11 counts only heads that have not come whole."""
        came = self.conn.trailing_data[0] if self.conn.their_state is h11.IDLE else b""
        if len(came) > MOST_HEAD and END_OF_HEAD.search(came, 0, MOST_HEAD) is None:
            self.send_400_response(f"expected a head of at most {MOST_HEAD} bytes\n")
            return
        super().handle_events()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Hand the connection on: what ends it then is `BoundedWebSocket`."""
        self._forget_end()
        super().handle_websocket_upgrade(event)

    def _forget_end(self) -> None:
        if self._end is not None:
            self._end.cancel()


class BoundedWebSocket(WebSocketsSansIOProtocol):
    """WebSocket; a connection that is not accepted in CLOSING_S ends, and one that is closed ends CLOSING_S later."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a connection."""
        super().connection_made(transport)
        self._end = self.loop.call_later(CLOSING_S, self._end_unless_open)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._end.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take what came, unless the client does not read: each of its pings would be answered all the same."""
        if self.transport.get_write_buffer_size() > MOST_UNSENT:
            self.transport.abort()
            return
        super().data_received(data)

    def handle_cont(self, event: Any) -> None:
        """Take a piece of a message."""
        if len(self.frames) >= MOST_PIECES:
            self.transport.abort()
            return
        super().handle_cont(event)

    def send_receive_event_to_app(self) -> None:
        """Hand a message on, unless it is called text and is none: that is nothing to be logged."""
        if self.curr_msg_data_type == "text" and not _is_text(b"".join(self.frames)):
            self.transport.abort()
            return
        super().send_receive_event_to_app()

    async def send(self, message: Any) -> None:
        """Send, unless the connection was closed by what the client sent while this was on its way."""
        if self.close_sent and message["type"] == "websocket.send":
            raise ClientDisconnected
        await super().send(message)

    def keepalive_timeout(self) -> None:
        """End a connection whose client answers no ping."""
        super().keepalive_timeout()
        self._end_soon()

    async def run_asgi(self) -> None:
        """Serve; then end, though the client may take nothing of what is left."""
        try:
            await super().run_asgi()
        finally:
            self._end_soon()

    def _end_unless_open(self) -> None:
        if not self.handshake_complete or self.close_sent:
            self.transport.abort()

    def _end_soon(self) -> None:
        self._end.cancel()
        self._end = self.loop.call_later(CLOSING_S, self.transport.abort)


def _is_text(content: bytes) -> bool:
    try:
        content.decode()
    except UnicodeDecodeError:
        return False
    return True
