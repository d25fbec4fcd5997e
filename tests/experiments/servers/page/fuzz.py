"""Hostile requests and frames, drawn at random, against a server that goes on serving an honest client.

python -m tests.experiments.servers.page.fuzz [N]    # 100,000 without N: how many, how long, what the honest client saw
"""

from __future__ import annotations

import json
import random
import resource
import socket
import sys
import time

from tests.experiments.servers.page import messages
from tests.experiments.servers.page.served import SOON_S, TOKEN, Served, served
from tests.experiments.servers.page.test_access import stream

PER_CONNECTION = 50
"""Frames on one connection, at most: a fault ends it."""


def request(rng: random.Random, port: int) -> bytes:
    """A request that is none, almost one, or one of another host."""
    host = b"Host: 127.0.0.1:%d\r\n" % port
    head = b"GET / HTTP/1.1\r\n" + host
    whole = bytearray(head + b"Accept: */*\r\n\r\n")
    for _ in range(rng.randrange(1, 6)):
        whole[rng.randrange(len(whole))] = rng.randrange(256)
    key = b"Sec-WebSocket-Key: " + rng.randbytes(9).hex().encode()
    kinds = [
        bytes(whole),
        rng.randbytes(rng.randrange(1, 2000)),
        head + b"X: " + b"y" * rng.randrange(1, 40_000) + b"\r\n\r\n",
        b"POST / HTTP/1.1\r\n" + host + b"Content-Length: %d\r\n\r\nabc" % rng.choice([-1, 3, 10**18]),
        head + b"Transfer-Encoding: chunked\r\n\r\n%x\r\n" % rng.getrandbits(64),
        b"GET /" + rng.randbytes(20).replace(b"\n", b"") + b" HTTP/1.1\r\nHost: " + rng.randbytes(8) + b"\r\n\r\n",
        (head + b"\r\n") * rng.randrange(2, 30),
        head + b"Upgrade: websocket\r\nConnection: Upgrade\r\n" + key + b"\r\n\r\n",
    ]
    return rng.choice(kinds)


def frame(rng: random.Random) -> bytes:
    """A WebSocket frame: whole with hostile content, cut, too long, reserved, or not masked."""
    texts = [
        b'{"command": "pause", "on": 1}',
        b'{"command": "fix", "place_px": [1e999, 2]}',
        b'{"command": "hue", "node": "' + b"\\u0000" * 500 + b'", "place_px": [0, 0]}',
        b"[" * 5000,
        b"\xff\xfe",
        b"next",
        b"",
        rng.randbytes(rng.randrange(1, 200)),
    ]
    content = rng.choice(texts)
    first = rng.choice([0x81, 0x81, 0x81, 0x82, 0x01, 0x80, 0x89, 0x8A, 0x88, 0xF1, rng.randrange(256)])
    mask = rng.randbytes(4)
    masked = bytes(c ^ mask[k % 4] for k, c in enumerate(content))
    length = len(content) if rng.random() < 0.9 else rng.getrandbits(rng.choice([7, 16, 63]))
    bit = 0x80 if rng.random() < 0.95 else 0
    if length < 126:
        head = bytes([first, bit | length])
    elif length < 65_536:
        head = bytes([first, bit | 126]) + length.to_bytes(2, "big")
    else:
        head = bytes([first, bit | 127]) + length.to_bytes(8, "big")
    return head + (mask if bit else b"") + (masked if bit else content)


def handshake(one: Served) -> socket.socket:
    """A connection of the stream, with the token, as far as its first answer."""
    raw = socket.create_connection(("127.0.0.1", one.port), timeout=SOON_S)
    raw.sendall(
        b"GET /stream HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\n"
        b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: softaim.v1, token.%s\r\n\r\n"
        % (one.port, TOKEN.encode())
    )
    assert raw.recv(65_536).startswith(b"HTTP/1.1 101")
    return raw


def attack(one: Served, rng: random.Random) -> int:
    """One hostile connection; how many messages were sent on it."""
    sent = 0
    try:
        if rng.random() < 0.2:
            with socket.create_connection(("127.0.0.1", one.port), timeout=SOON_S) as raw:
                raw.sendall(request(rng, one.port))
                raw.settimeout(0.002)
                raw.recv(1000)
            return 1
        with handshake(one) as raw:
            while sent < PER_CONNECTION:
                raw.sendall(frame(rng))
                sent += 1
    except OSError:  # the connection was ended, which is right
        sent += 1
    return sent


def trial(n: int, seed: int = 0) -> dict[str, float]:
    """Send n hostile messages while a client watches; AssertionError where a state does not come to it."""
    rng, sent, waits, works = random.Random(seed), 0, [0.0], [0.0]
    with served(messages.scene()) as one, stream(one, query="?pace=1") as honest:
        honest.recv(SOON_S)
        began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        number = 0
        while sent < n:
            for _ in range(5):
                sent += attack(one, rng)
            number += 1
            asked, worked = time.monotonic(), time.process_time()
            one.publish(messages.state(number))
            assert json.loads(honest.recv(SOON_S))["counters"]["frames"] == number
            honest.send("next")
            waits.append(time.monotonic() - asked)
            works.append(time.process_time() - worked)
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        longest = {"longest_wait_ms": 1e3 * max(waits), "longest_work_ms": 1e3 * max(works)}
        return {"sent": sent, "s": time.monotonic() - began, "grown_mb": grown / 1024, **longest}


if __name__ == "__main__":
    print(json.dumps(trial(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)))
