"""OpenIGTLink server: sends the newest state of the run to each client, and passes the clients' messages to the loop.

A client that leaves, is stuck, or sends an invalid message is dropped without effect on other clients. For users:
docs/openigtlink.md.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import logging
import socket
import time
from dataclasses import dataclass

from experiments.log import LOG
from experiments.servers.commands import UNSEEN
from experiments.servers.feed import Feed
from experiments.servers.openigtlink.bodies import StatusBody
from experiments.servers.openigtlink.codec import HEADER, MalformedError, decode, decode_header
from experiments.servers.openigtlink.incoming import Incoming, RefusedError
from experiments.servers.openigtlink.outgoing import (
    HEALTH,
    REPLY,
    Code,
    Packet,
    packet_of,
    sphere_message,
    status_message,
)


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """Limits of the server.

    clients: largest number of clients; another client gets the status BUSY and is dropped; a requirement
    message_s: longest time from a message's first byte to its last [s]; source: pyigtl's limit for a body
    stuck_s: time after which a client that receives nothing is dropped [s]; choice
    kernel_bytes: size that is requested for a client's socket buffer [bytes]; Linux doubles it; choice: room for ten
    states of the run, so that a slow client does not read old states
    """

    clients: int = 16
    message_s: float = 5.0
    stuck_s: float = 2.0
    kernel_bytes: int = 16384


SETTINGS = LinkSettings()
GONE = (OSError, asyncio.IncompleteReadError)
"""Exceptions of a connection whose client leaves; a TimeoutError is an OSError, too."""


async def serve(sock: socket.socket, feed: Feed, *, settings: LinkSettings = SETTINGS) -> None:
    """Serve clients until cancelled, then close all connections and the socket; sock: a bound socket."""
    await _Server(feed, settings).run(sock)


class _Server:
    """Makes a packet of each state of the run and sends it to each client."""

    def __init__(self, feed: Feed, settings: LinkSettings) -> None:
        self._feed, self._settings, self._sphere = feed, settings, sphere_message()
        self._clients: set[asyncio.Task[None]] = set()
        self._n_dropped = 0
        self._packet, self._count = Packet(b""), 0
        self._next = asyncio.Event()

    async def run(self, sock: socket.socket) -> None:
        server = await asyncio.start_server(self._connected, sock=sock)
        try:
            await self._follow()
        finally:
            server.close()
            for client in self._clients:
                client.cancel()
            await asyncio.gather(*self._clients, return_exceptions=True)

    async def _follow(self) -> None:
        """Make a packet of each state from now on; if no state comes in time, make a packet that reports stale data."""
        number = 0 if self._feed.newest is None else self._feed.newest.number
        stale_s = 1e-3 * self._feed.scene["stale_ms"]
        while True:
            moment = await self._feed.after(number, stale_s)
            if moment is not None:
                number = moment.number
            if not self._clients:
                continue
            self._packet = _stale(stale_s) if moment is None else packet_of(json.loads(moment.text))
            self._count += 1
            self._next.set()
            self._next = asyncio.Event()

    def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._clients) >= self._settings.clients:
            writer.write(_refusal(Code.BUSY, f"{self._settings.clients} clients are already served"))
            writer.close()
            return
        task = asyncio.get_running_loop().create_task(self._client(reader, writer))
        self._clients.add(task)
        task.add_done_callback(self._clients.discard)

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client until it leaves or is dropped."""
        writer.transport.set_write_buffer_limits(high=0)
        _keep_little(writer.get_extra_info("socket"), self._settings.kernel_bytes)
        incoming = Incoming(self._feed.scene["dim"])
        tasks = [
            asyncio.create_task(self._tell(writer, incoming)),
            asyncio.create_task(self._hear(reader, writer, incoming)),
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                error = task.exception()
                self._report(error, _name(writer))
                if isinstance(error, MalformedError) and incoming.sends_needle and _is_local(writer):
                    self._feed.command(UNSEEN)
        finally:
            for task in tasks:
                task.cancel()
            writer.transport.abort()  # before waiting: the server may be cancelled meanwhile
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _tell(self, writer: asyncio.StreamWriter, incoming: Incoming) -> None:
        """Send the sphere, then always the newest packet; packets that come during a transmission are skipped."""
        writer.write(self._sphere)
        sent = self._count
        while True:
            async with asyncio.timeout(self._settings.stuck_s):
                await writer.drain()
            while self._count == sent:
                await self._next.wait()
            sent = self._count
            writer.write(self._packet.common + (b"" if incoming.sends_needle else self._packet.needle))

    async def _hear(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, incoming: Incoming) -> None:
        """Pass on the client's requests until an exception is raised: one of GONE, or MalformedError."""
        may_write = _is_local(writer)
        while True:
            first = await reader.readexactly(1)
            async with asyncio.timeout(self._settings.message_s):
                header = decode_header(first + await reader.readexactly(HEADER.size - 1))
                message = decode(header, await reader.readexactly(header.size))
            try:
                commands = incoming.commands(message)
            except RefusedError as error:
                _answer(writer, Code.ILLEGAL_INSTRUCTION, str(error))
                commands = list(error.instead) if may_write else []
            if commands and not may_write:
                _answer(
                    writer, Code.ACCESS_DENIED, "needles and points are accepted from programs on this machine only"
                )
                commands = []
            for command in commands:
                self._feed.command(command)
            # reading waiting messages does not yield to the event loop, so other clients get their turn here
            await asyncio.sleep(0)

    def _report(self, error: BaseException | None, name: str) -> None:
        """Log why a client was dropped, but not if it left. Only the 1st, 2nd, 4th, 8th and so on is logged."""
        if error is None or (isinstance(error, GONE) and not isinstance(error, TimeoutError)):
            return
        self._n_dropped += 1
        if self._n_dropped & (self._n_dropped - 1):
            return
        level = logging.INFO if isinstance(error, MalformedError | TimeoutError) else logging.ERROR
        LOG.log(level, "OpenIGTLink: %d dropped, the last from %s: %s", self._n_dropped, name, str(error) or "stuck")


def _stale(stale_s: float) -> Packet:
    text = f"nothing new for {1e3 * stale_s:.0f} ms: the data are not current"
    return Packet(status_message(HEALTH, StatusBody(Code.TIME_OUT, "STALE", text), time.time()))


def _refusal(code: Code, text: str) -> bytes:
    return status_message(REPLY, StatusBody(code, "REFUSED", text), time.time())


def _answer(writer: asyncio.StreamWriter, code: Code, text: str) -> None:
    """Send the reason why a request failed; if the client is still receiving earlier data, send nothing."""
    if writer.transport.get_write_buffer_size() == 0:
        writer.write(_refusal(code, text))


def _keep_little(sock: socket.socket, n_bytes: int) -> None:
    """Limit the data that the operating system buffers for a client."""
    with contextlib.suppress(OSError):
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, n_bytes)
    with contextlib.suppress(OSError, AttributeError):
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, 1)


def _name(writer: asyncio.StreamWriter) -> str:
    return str((writer.get_extra_info("peername") or ("a client",))[0])


def _is_local(writer: asyncio.StreamWriter) -> bool:
    """Whether the client is connected over loopback."""
    try:
        address = ipaddress.ip_address(_name(writer).partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None)
    return (mapped or address).is_loopback
