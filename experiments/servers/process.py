"""Process that serves a live run: it passes states from the loop to the feed, and requests of clients to the loop."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Awaitable, Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any

from experiments.servers.faces import Faces, names_of
from experiments.servers.feed import Feed
from experiments.threads import begin_helper

LONGEST = 64 * 1024 * 1024
"""Largest number of bytes of one message from the loop; choice: an 8K picture has 20 MB."""


def serve(connection: Connection, faces: Faces) -> None:
    """Serve clients until the run's loop ends, or until the process of the loop is gone."""
    begin_helper(connected=True)
    asyncio.run(_Served(connection, faces).run())


class _Served:
    """The servers of one run."""

    def __init__(self, connection: Connection, faces: Faces) -> None:
        self._connection, self._faces = connection, faces
        self._writing = threading.Lock()
        self._ended = asyncio.Event()

    async def run(self) -> None:
        """Serve until the connection closes."""
        loop = asyncio.get_running_loop()
        runs = self._servers()  # load the servers' modules while the loop also loads
        scene = await loop.run_in_executor(None, self._received)
        if not scene:
            return
        feed = Feed(json.loads(scene), self._send)
        servers = [asyncio.create_task(self._watched(name, run(feed))) for name, run in runs]
        reader = threading.Thread(target=self._read, args=(loop, feed), daemon=True)
        self._ready(feed)
        reader.start()
        await self._ended.wait()
        for server in servers:
            server.cancel()
        await asyncio.gather(*servers, return_exceptions=True)

    def _servers(self) -> list[tuple[str, Callable[[Feed], Awaitable[None]]]]:
        faces = self._faces
        servers: list[tuple[str, Callable[[Feed], Awaitable[None]]]] = []
        if (listener := faces.openigtlink) is not None:
            from experiments.servers.openigtlink.server import serve as openigtlink

            servers.append(("OpenIGTLink", lambda feed: openigtlink(listener, feed)))
        if (page := faces.page) is not None:
            from experiments.servers.page.serving import serve as serve_page

            hosts, token, read_open = names_of(page), faces.token, faces.read_open
            servers.append(("page", lambda feed: serve_page(page, feed, hosts=hosts, token=token, read_open=read_open)))
        return servers

    async def _watched(self, name: str, server: Awaitable[None]) -> None:
        """Run a server; if it fails, the other servers continue."""
        try:
            await server
        except Exception as error:
            self._send({"fault": f"{name}: {type(error).__name__}: {error}; the run continues without it"})

    def _read(self, loop: asyncio.AbstractEventLoop, feed: Feed) -> None:
        while (text := self._received()) and (picture := self._received()) is not None:
            loop.call_soon_threadsafe(self._take, feed, text, picture or None)
        loop.call_soon_threadsafe(self._ended.set)

    def _take(self, feed: Feed, text: bytes, picture: bytes | None) -> None:
        feed.publish(text, picture)
        self._ready(feed)

    def _ready(self, feed: Feed) -> None:
        self._send({"ready": True, "watching": feed.n_watching})

    def _received(self) -> bytes | None:
        try:
            return self._connection.recv_bytes(LONGEST)
        except (OSError, EOFError):
            return None

    def _send(self, message: Mapping[str, Any]) -> None:
        try:
            with self._writing:
                self._connection.send_bytes(json.dumps(message).encode())
        except OSError:
            self._ended.set()
