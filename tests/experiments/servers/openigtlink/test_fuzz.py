"""Mutated messages: the codec refuses what is none, and the server goes on for everybody else.

SOFTAIM_FUZZ=100000 in the environment is how many.
"""

import asyncio
import contextlib
import math
import os
import random
import struct

import numpy as np

from experiments.servers.commands import read_command
from experiments.servers.openigtlink.bodies import (
    StatusBody,
    pack_status,
    pack_string,
    pack_transform,
    read_points,
    read_transform,
)
from experiments.servers.openigtlink.codec import HEADER, MalformedError, Message, decode, decode_header, encode
from experiments.servers.openigtlink.crc import crc64
from experiments.servers.openigtlink.incoming import Incoming, RefusedError
from tests.experiments.servers.openigtlink import published
from tests.experiments.servers.openigtlink.connections import Client, awaited, connected, feed_of, publish, serving

N_MESSAGES = int(os.environ.get("SOFTAIM_FUZZ", "3000"))
N_ATTACKERS = 4
OK = {"TransformStatus": "OK"}
WHOLE = [
    published.TRANSFORM,
    published.TRANSFORM_WITH_METADATA,
    published.STATUS,
    published.STRING,
    published.POINT,
    published.POLYDATA,
    encode(Message("TRANSFORM", "NeedleTipToReference", pack_transform(np.eye(4)), 1.8e9, OK)),
    encode(Message("POINT", "F", published.POINT[58:])),
    encode(Message("STATUS", "a", pack_status(StatusBody(1, "OK", "fine")))),
    encode(Message("STRING", "a", pack_string("fine"))),
    encode(Message("GET_STATUS", "", b"")),
]


def mutated(rng: random.Random) -> bytes:
    """A message with something wrong with it; of half of them the size and the checksum are right all the same."""
    found = bytearray(rng.choice(WHOLE))
    kind = rng.randrange(6)
    if kind == 0:
        for _ in range(rng.randint(1, 8)):
            found[rng.randrange(len(found))] = rng.randrange(256)
    elif kind == 1:
        at = rng.randrange(len(found) - 3)
        found[at : at + 4] = struct.pack(">I", rng.choice([0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FC00000]))
    elif kind == 2:
        del found[rng.randrange(len(found)) :]
    elif kind == 3:
        at = rng.randrange(len(found))
        found[at:at] = rng.randbytes(rng.randint(1, 200))
    elif kind == 4:
        found[42:50] = struct.pack(">Q", rng.choice([0, 65536, 65537, 2**32, 2**63, 2**64 - 1, rng.randrange(2**16)]))
    else:
        found = bytearray(rng.randbytes(rng.randint(1, 300)))
    if rng.random() < 0.5 and len(found) >= HEADER.size:
        body = bytes(found[HEADER.size :])
        found[42:58] = struct.pack(">QQ", len(body), crc64(body))
    return bytes(found)


def test_the_codec_refuses_what_is_no_message_and_nothing_else_happens():
    """Whatever is read of a mutated message, commands are finite; and among thousands some of each outcome come."""
    rng = random.Random(1)
    outcomes = {"malformed": 0, "refused": 0, "nothing": 0, "commands": 0}
    for _ in range(N_MESSAGES):
        found = mutated(rng)
        try:
            message = decode(decode_header(found[: HEADER.size]), found[HEADER.size :])
            for read in (read_transform, read_points):
                with contextlib.suppress(MalformedError):
                    read(message.content)
            commands = Incoming(3).commands(message)
        except MalformedError:
            outcomes["malformed"] += 1
        except RefusedError:
            outcomes["refused"] += 1
        else:
            outcomes["commands" if commands else "nothing"] += 1
            for command in commands:
                assert read_command(command)
                numbers = [n for value in command.values() if isinstance(value, list) for n in value]
                assert all(math.isfinite(n) for n in numbers)
    assert min(outcomes.values()) > 0


@awaited
async def test_the_server_goes_on_for_everybody_else():
    """Each mutated message on a connection of its own; another client gets moments all the while, and at the end."""
    rng = random.Random(2)
    n_each = max(N_MESSAGES // (1 if N_MESSAGES > 3000 else 5) // N_ATTACKERS, 1)

    async def attack(port: int) -> None:
        for _ in range(n_each):
            async with connected(port) as client:
                client.writer.write(mutated(rng))
                with contextlib.suppress(OSError):
                    if client.writer.can_write_eof():
                        client.writer.write_eof()
                    assert await client.is_dropped()

    async def watch(client: Client) -> None:
        nonlocal n_seen
        while True:
            await client.until("NeedleTipToReference")
            n_seen += 1

    async def moments(feed) -> None:
        while True:
            publish(feed)
            await asyncio.sleep(1 / 60)

    (feed, commands), n_seen = feed_of(), 0
    async with serving(feed) as port, connected(port) as good:
        others = [asyncio.create_task(watch(good)), asyncio.create_task(moments(feed))]
        await asyncio.gather(*(attack(port) for _ in range(N_ATTACKERS)))
        before = n_seen
        while n_seen < before + 3:
            await asyncio.sleep(0.01)
            assert not any(task.done() for task in others)
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)
    for command in commands:
        assert read_command(command)
    assert len(asyncio.all_tasks()) == 2
