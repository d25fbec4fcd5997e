"""JSON stream to a viewer: the scene, then the newest state whenever the viewer is ready. The viewer may send commands.

The server does not wait: a state is skipped if the viewer is still receiving an older one.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketDisconnected

from experiments.servers.commands import UNSEEN, is_needle, read_command
from experiments.servers.feed import Feed
from experiments.servers.page.access import PROTOCOL, Access

MOST_CLIENTS = 16
"""Largest number of viewers and programs at a time; a requirement."""
STUCK_S = 10.0
"""Time after which a client that receives nothing is dropped [s]; choice: the client may connect again later."""
NEXT = "next"
"""Message by which a client with `?pace=1` in its URL reports that it is ready for the next state."""
WRONG_TOKEN, TOO_MANY, NOT_TEXT = 4401, 1013, 1003
"""WebSocket closing codes: wrong token, too many clients, not text."""
GONE = (WebSocketDisconnect, WebSocketDisconnected, TimeoutError)
"""Exceptions of sending: two for a client that is gone (at the first send, at a later one), one for a stuck client."""
LONGEST_ERROR = 200
"""Largest number of letters of an error in an answer: an error may quote the client's input, which may be long."""


class Stream:
    """WebSocket endpoint for the clients of a feed."""

    def __init__(self, feed: Feed, access: Access) -> None:
        self._feed, self._access = feed, access
        self._n_clients = 0

    async def serve(self, socket: WebSocket) -> None:
        """Serve one client until it leaves, is stuck, or breaks the protocol."""
        offered = socket.scope["subprotocols"]
        await socket.accept(subprotocol=PROTOCOL if PROTOCOL in offered else None)
        may_read, may_write = self._access.grant(offered)
        if not may_read:
            await socket.close(WRONG_TOKEN, "a token is required; it was missing or wrong")
            return
        if self._n_clients >= MOST_CLIENTS:
            await socket.close(TOO_MANY, f"{MOST_CLIENTS} clients are already connected")
            return
        viewer = Viewer(socket, self._feed, may_write=may_write)
        self._n_clients += 1
        self._feed.n_watching += viewer.pictures
        try:
            await viewer.serve()
        finally:
            self._n_clients -= 1
            self._feed.n_watching -= viewer.pictures


class Viewer:
    """Connection of one client.

    pictures: whether the client requests pictures, with `?pictures=1` in the URL
    If the URL has `?pace=1`, the client itself reports when it is ready for the next state.
    """

    def __init__(self, socket: WebSocket, feed: Feed, *, may_write: bool) -> None:
        self._socket, self._feed, self._may_write = socket, feed, may_write
        self.pictures = socket.query_params.get("pictures") == "1"
        self._paced = socket.query_params.get("pace") == "1"
        self._ready = asyncio.Event()
        self._ready.set()
        self._sending = asyncio.Lock()

    async def serve(self) -> None:
        """Send states and receive messages, until sending or receiving ends."""
        ends = [asyncio.create_task(one) for one in (self._send_states(), self._receive())]
        try:
            done, _ = await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for end in ends:
                end.cancel()
            await asyncio.gather(*ends, return_exceptions=True)
        for end in done:
            if not isinstance(end.exception(), GONE):
                end.result()

    async def _send_states(self) -> None:
        await self._send(json.dumps({**self._feed.scene, "may_write": self._may_write}))
        number = 0
        while True:
            await self._ready.wait()
            moment = await self._feed.after(number)
            if moment is None:
                continue
            number = moment.number
            if self._paced:
                self._ready.clear()
            await self._send(moment.text.decode(), moment.picture if self.pictures else None)

    async def _receive(self) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if text is None:
                await self._socket.close(NOT_TEXT, "commands are text")
                return
            if text == NEXT:
                self._ready.set()
            else:
                await self._send(json.dumps(self._answer(text)))
            await asyncio.sleep(0)  # a client that sends without pause must not block other clients

    def _answer(self, text: str) -> Mapping[str, Any]:
        """Pass a command to the loop; returns the answer for the client."""
        name = None
        try:
            command = read_command(text)
            name = command.command
            if not self._may_write:
                raise ValueError("a token is required to write")
            self._feed.command(command.model_dump())
        except ValueError as error:
            if self._may_write and is_needle(text):
                with suppress(ValueError):
                    self._feed.command(UNSEEN)
            return {"type": "answer", "command": name, "error": str(error)[:LONGEST_ERROR]}
        return {"type": "answer", "command": name, "error": None}

    async def _send(self, text: str, picture: bytes | None = None) -> None:
        """Send a message, and its picture right after it. Raises TimeoutError if the client is stuck."""
        async with asyncio.timeout(STUCK_S), self._sending:
            await self._socket.send_text(text)
            if picture is not None:
                await self._socket.send_bytes(picture)
