"""A server on a free port of the loopback, clients of it, and states of a live run for them."""

import socket
import struct
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Self

from experiments.servers.openigtlink.codec import HEADER, Message, decode, decode_header
from experiments.servers.openigtlink.server import SETTINGS, LinkSettings, serve
from tests.experiments.servers.page.served import SOON_S, Served, served

NEVER_STALE = 3_600_000
"""In place of 200 ms where staleness is not the point: a busy machine takes long."""
UTC_S = 1.8e9 + 0.3125
"""In binary fractions, so that no codec has to round it."""
SCENE = {"type": "scene", "dim": 2, "stale_ms": 200}


def status_in(message: Message) -> tuple[int, str]:
    """Code and name of a STATUS."""
    code, _, name = struct.unpack_from(">Hq20s", message.content)
    return code, name.rstrip(b"\0").decode()


def state(**other: Any) -> dict[str, Any]:
    """Of tissue in a plane, tracked, with a needle and advice; `other` in place of these keys."""
    return {
        "type": "state",
        "time_s": 12.5,
        "utc_s": UTC_S,
        "status": "TRACKING",
        "fault": None,
        "paused": False,
        "target_mm": [1.5, -20.25],
        "cov_mm2": [[4.0, 1.0], [1.0, 2.0]],
        "sigma_mm": 2.1,
        "marks_used": 3,
        "nis": 5.5,
        "poked": 0.25,
        "advice": {"advice": "GO", "reason": "a hit is probable", "probability": 0.97},
        "needle": {"tip_mm": [10.0, -50.0], "direction": [0.0, 2.0]},
    } | other


@contextmanager
def serving(settings: LinkSettings = SETTINGS, **scene: Any) -> Iterator[Served]:
    """A server of the scene with these keys; afterwards it is cancelled, and has closed its socket."""

    def begun(one: Served) -> Coroutine[Any, Any, None]:
        one.feed.publish(b"{}", None)  # of unknown age: it is not sent
        return serve(one.sock, one.feed, settings=settings)

    with served(SCENE | {"stale_ms": NEVER_STALE} | scene, by=begun) as one:
        yield one
    assert one.sock.fileno() == -1


class Client:
    """One connection."""

    def __init__(self, one: Served) -> None:
        self.socket = socket.create_connection(("127.0.0.1", one.port), SOON_S)
        self._received = self.socket.makefile("rb")

    def next(self) -> Message:
        """The next message."""
        header = decode_header(self._received.read(HEADER.size))
        return decode(header, self._received.read(header.size))

    def until(self, device: str) -> Message:
        """The next message of this device."""
        while (message := self.next()).device != device:
            pass
        return message

    def is_dropped(self) -> bool:
        """Whether the server closes the connection soon; what it sent before is read away."""
        with suppress(ConnectionError):
            while self._received.read1(65536):
                pass
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._received.close()
        self.socket.close()


def with_little_room(one: Served) -> socket.socket:
    """A client whose system holds little that it has not read."""
    found = socket.socket()
    found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    found.connect(("127.0.0.1", one.port))
    found.setblocking(False)
    return found
