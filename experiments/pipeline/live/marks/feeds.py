"""Feeds of marks as lines: datagrams of UDP, and a pipe."""

from __future__ import annotations

import os
import socket
from urllib.parse import urlsplit

from experiments.pipeline.live.marks.lines import LONGEST_LINE
from experiments.pipeline.live.marks.receiver import SETTINGS, LiveMarks
from vision import SourceError

POLL_S = 0.1
"""Interval at which a waiting feed checks whether it has to stop [s]; lines are processed without this delay."""

LOOPBACK = "127.0.0.1"


class UdpFeed:
    """Feed of lines in UDP datagrams at a port of this machine. Raises SourceError if the port is in use.

    host: local address to listen on; by default only programs on this machine can send
    Only one host may send: other hosts are refused until this host has been silent for SETTINGS.hung_s.
    """

    def __init__(self, port: int, host: str = LOOPBACK) -> None:
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            try:
                self._socket.bind(address)
            except OSError:
                self._socket.close()
                raise
        except OSError as error:
            text = (error.strerror or type(error).__name__).lower()
            raise SourceError(f"expected a free port and an address of this machine, found {text}") from error
        self._socket.settimeout(POLL_S)
        self._sender, self._heard_s = "", -float("inf")

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the feed."""
        host, port, *_ = self._socket.getsockname()
        return host, port

    def run(self, receiver: LiveMarks) -> None:
        """Deliver datagrams until the receiver is closed."""
        while receiver.wanted:
            try:
                datagram, sender = self._socket.recvfrom(LONGEST_LINE + 1)
            except TimeoutError:
                continue
            except OSError:
                if receiver.wanted:
                    raise
                return
            now = receiver.clock()
            if sender[0] != self._sender and now - self._heard_s < SETTINGS.hung_s:
                receiver.refuse("of another sender", f"expected frames of {self._sender}, found {sender[0]}")
                continue
            self._sender, self._heard_s = sender[0], now
            for line in datagram.split(b"\n"):
                receiver.take_line(line)

    def close(self) -> None:
        """Close the port."""
        self._socket.close()


def udp_feed(address: str) -> UdpFeed:
    """The feed of `udp://:PORT` or `udp://HOST:PORT`; HOST is an address of this machine. Raises SourceError."""
    try:
        parts = urlsplit(address)
        port, spare = parts.port, parts.path.strip("/") or parts.query or parts.username
        host = parts.hostname or LOOPBACK
        host.encode("idna")  # reports an invalid name here as ValueError; getaddrinfo would raise it later
    except ValueError:
        port, spare, host = None, None, LOOPBACK
    if not port or spare:
        raise SourceError("expected udp://:PORT or udp://HOST:PORT, PORT from 1 to 65535, found neither")
    return UdpFeed(port, host)


class PipeFeed:
    """Feed of lines from a pipe or terminal.

    descriptor: file descriptor of the pipe, such as 0 for standard input. The pipe is read without Python's buffers: a
    read that waits for input would lock the buffer, so that the program could not end.
    """

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self._rest, self._too_long = b"", False

    def run(self, receiver: LiveMarks) -> None:
        """Deliver lines until the pipe ends; the last line needs no line break."""
        while receiver.wanted:
            read = os.read(self._descriptor, LONGEST_LINE)
            *lines, rest = (self._rest + read).split(b"\n") if read else (self._rest, b"")
            for line in lines:
                if not self._too_long:
                    receiver.take_line(line)
                self._too_long = False
            if self._too_long or len(rest) > LONGEST_LINE:
                if not self._too_long:
                    receiver.take_line(rest)  # take_line refuses it
                rest, self._too_long = b"", True
            self._rest = rest
            if not read:
                return

    def close(self) -> None:
        """Nothing to release: the pipe belongs to the program."""
