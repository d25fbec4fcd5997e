"""uvicorn's protocols, hardened against hostile clients: every connection has bounded memory and duration.

`python -m tests.experiments.servers.page.fuzz` sends 100,000 hostile inputs.
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
"""Largest number of connections of all kinds; choice: 16 clients, and 16 page loads with three connections each."""
REQUESTS_S = 20.0
"""Longest duration of a connection that is not a WebSocket [s]; choice: fetching a page takes less."""
CLOSING_S = 2.0
"""Longest duration of a WebSocket's opening and of its closing [s]; choice."""
MOST_UNSENT = 8 * 2**20
"""Largest number of bytes waiting for a client that sends but does not read; choice: more than the largest picture."""
MOST_HEAD = 16_384
"""Largest number of bytes of a request's line and headers; choice: the page itself sends 1000 bytes."""
MOST_PIECES = 256
"""Largest number of WebSocket frames in one message; choice. A limit on the size would not stop empty frames."""


END_OF_HEAD = re.compile(rb"\n\r?\n")
"""Pattern of the end of a request's head, the same as in h11."""


class BoundedHttp(H11Protocol):
    """HTTP protocol that limits the number of connections, the duration of each, and the size of a request's head."""

    _end: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept a connection; if there are already `MOST_CONNECTIONS`, end the new one immediately."""
        crowded = len(self.connections) >= MOST_CONNECTIONS
        super().connection_made(transport)
        if crowded:
            transport.abort()
        else:
            self._end = self.loop.call_later(REQUESTS_S, transport.abort)

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the timer of a lost connection."""
        self._forget_end()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Answer a request. Refuse it if its head is too long: h11 limits a head only until the head is complete."""
        came = self.conn.trailing_data[0] if self.conn.their_state is h11.IDLE else b""
        if len(came) > MOST_HEAD and END_OF_HEAD.search(came, 0, MOST_HEAD) is None:
            self.send_400_response(f"expected a head of at most {MOST_HEAD} bytes\n")
            return
        super().handle_events()

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Change the connection's protocol to `BoundedWebSocket`, which has its own limits."""
        self._forget_end()
        super().handle_websocket_upgrade(event)

    def _forget_end(self) -> None:
        if self._end is not None:
            self._end.cancel()


class BoundedWebSocket(WebSocketsSansIOProtocol):
    """WebSocket protocol; ends a connection whose opening or closing takes longer than CLOSING_S."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept a connection."""
        super().connection_made(transport)
        self._end = self.loop.call_later(CLOSING_S, self._end_unless_open)

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the timer of a lost connection."""
        self._end.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Receive data. End the connection if the client does not read: answers to pings would fill the memory."""
        if self.transport.get_write_buffer_size() > MOST_UNSENT:
            self.transport.abort()
            return
        super().data_received(data)

    def handle_cont(self, event: Any) -> None:
        """Receive part of a message."""
        if len(self.frames) >= MOST_PIECES:
            self.transport.abort()
            return
        super().handle_cont(event)

    def send_receive_event_to_app(self) -> None:
        """Pass a message to the application; if its text is not UTF-8, end the connection without a log entry."""
        if self.curr_msg_data_type == "text" and not _is_text(b"".join(self.frames)):
            self.transport.abort()
            return
        super().send_receive_event_to_app()

    async def send(self, message: Any) -> None:
        """Send a message; raises ClientDisconnected if the client's input has closed the connection meanwhile."""
        if self.close_sent and message["type"] == "websocket.send":
            raise ClientDisconnected
        await super().send(message)

    def keepalive_timeout(self) -> None:
        """End a connection whose client does not answer pings."""
        super().keepalive_timeout()
        self._end_soon()

    async def run_asgi(self) -> None:
        """Serve; then end the connection, even if the client has not received all data."""
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
