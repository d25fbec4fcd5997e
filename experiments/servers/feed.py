"""Newest state of a live run in the serving process; any number of clients read it without delaying the run.

The module `message` defines the messages. A feed is used in one asyncio loop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

Message = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Moment:
    """A state of the run. number: from 1; text: JSON; picture: JPEG, or None without a picture."""

    number: int
    text: bytes
    picture: bytes | None


class Feed:
    """Newest state of a live run, and a channel for commands to the run.

    send: passes a command to the loop without waiting; the loop may refuse the command
    scene: the message with all constant values, sent to viewers first
    newest: the newest state; n_watching: number of clients that request pictures
    """

    def __init__(self, scene: Message, send: Callable[[Message], None] = lambda _command: None) -> None:
        self.scene, self.command = scene, send
        self.newest: Moment | None = None
        self.n_watching = 0
        self._changed = asyncio.Event()

    def publish(self, text: bytes, picture: bytes | None) -> None:
        """Store a state that the loop has published."""
        self.newest = Moment(1 if self.newest is None else self.newest.number + 1, text, picture)
        self._changed.set()
        self._changed = asyncio.Event()

    async def after(self, number: int, timeout_s: float | None = None) -> Moment | None:
        """Wait for a state with a larger number than `number`; returns the newest, or None after timeout_s [s]."""
        try:
            async with asyncio.timeout(timeout_s):
                while self.newest is None or self.newest.number <= number:
                    await self._changed.wait()
        except TimeoutError:
            return None
        return self.newest
