"""Needle poses on the loopback that are none: what the client is answered, and what becomes of the needle."""

import asyncio

import numpy as np
import pytest

from experiments.servers.openigtlink.bodies import pack_transform, read_status
from experiments.servers.openigtlink.codec import Message, encode
from experiments.servers.openigtlink.outgoing import Code
from tests.experiments.servers.openigtlink.connections import SOON_S, connected, serving, told_of

NEVER_STALE = 3_600_000
"""In place of 200 ms: a busy machine takes long."""
NEEDLE = encode(Message("TRANSFORM", "NeedleTipToReference", pack_transform(np.eye(4))))


def run(scenario) -> None:
    """Run a coroutine, which must not take for ever."""
    asyncio.run(asyncio.wait_for(scenario, 5.0 * SOON_S))


def test_a_pose_that_makes_no_sense_is_answered():
    async def scenario() -> None:
        feed, commands = told_of(stale_ms=NEVER_STALE, dim=3)
        async with serving(feed) as port, connected(port) as client:
            await client.next()
            client.writer.write(encode(Message("TRANSFORM", "NeedleTipToReference", pack_transform(2.0 * np.eye(4)))))
            said = read_status((await client.until("SoftaimReply")).content)
            assert said.code == Code.ILLEGAL_INSTRUCTION
            client.writer.write(NEEDLE)
            async with asyncio.timeout(SOON_S):
                while len(commands) < 2:
                    await asyncio.sleep(0.01)
            assert [command["command"] for command in commands] == ["needle_unseen", "needle"]

    run(scenario())


@pytest.mark.parametrize(
    "content",
    [pack_transform(1.03 * np.eye(4)), pack_transform(np.diag([-1.0, 1.0, 1.0, 1.0])), bytes(47)],
    ids=["scaled", "mirrored", "of another size"],
)
def test_a_needle_whose_next_pose_is_refused_is_not_seen(content: bytes):
    async def scenario() -> None:
        feed, commands = told_of(stale_ms=NEVER_STALE, dim=3)
        async with serving(feed) as port, connected(port) as client:
            await client.next()
            client.writer.write(NEEDLE + encode(Message("TRANSFORM", "NeedleTipToReference", content)))
            async with asyncio.timeout(SOON_S):
                while len(commands) < 2:
                    await asyncio.sleep(0.01)
        assert [command["command"] for command in commands] == ["needle", "needle_unseen"]

    run(scenario())
