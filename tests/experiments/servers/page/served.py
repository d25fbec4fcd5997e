"""A page, or another server, in this process, on a port of its own, and what is fed to it."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from experiments.servers.faces import names_of
from experiments.servers.feed import Feed, Message
from experiments.servers.page.serving import serve
from tests.experiments.waiting import SOON_S, until

TOKEN = "a-token-of-tests"


class Served:
    """A feed served by a thread. State: the commands that came, and what the feed refuses them with."""

    def __init__(self, scene: Message) -> None:
        self.commands: list[Message] = []
        self.refusal: str | None = None
        self.sock = socket.create_server(("127.0.0.1", 0))
        self.port: int = self.sock.getsockname()[1]
        self.runner = asyncio.Runner()
        self.loop = self.runner.get_loop()
        self.feed = Feed(scene, self._take)

    def _take(self, command: Message) -> None:
        if self.refusal is not None:
            raise ValueError(self.refusal)
        self.commands.append(command)

    def publish(self, state: Mapping[str, Any], picture: bytes | None = None) -> None:
        """Publish a state from any thread."""
        self.loop.call_soon_threadsafe(self.feed.publish, json.dumps(state, allow_nan=False).encode(), picture)

    until = staticmethod(until)

    @property
    def address(self) -> str:
        """Of the page, with the token."""
        return f"http://127.0.0.1:{self.port}/#token={TOKEN}"


@contextmanager
def served(
    scene: Message, *, read_open: bool = True, by: Callable[[Served], Coroutine[Any, Any, None]] | None = None
) -> Iterator[Served]:
    """Serve a scene by the page, or by another server; afterwards the server has ended, by being cancelled."""
    one = Served(scene)
    page = {"hosts": names_of(one.sock), "token": TOKEN, "read_open": read_open}
    task = one.loop.create_task(serve(one.sock, one.feed, **page) if by is None else by(one))

    async def ended() -> None:
        with suppress(asyncio.CancelledError):
            await task

    def run() -> None:
        with one.runner:
            one.runner.run(ended())

    thread = threading.Thread(target=run, name="served")
    thread.start()
    try:
        yield one
    finally:
        one.loop.call_soon_threadsafe(task.cancel)
        thread.join(timeout=SOON_S)
        assert not thread.is_alive(), "the server did not end"
