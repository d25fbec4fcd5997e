"""The server on the loopback: its clients are pyigtl, and sockets that behave as no client should."""

import asyncio
import contextlib
import json
from itertools import pairwise

import numpy as np
import pyigtl
import pytest

from experiments.servers.commands import UNSEEN
from experiments.servers.openigtlink.bodies import pack_transform
from experiments.servers.openigtlink.codec import Message, encode
from experiments.servers.openigtlink.outgoing import Code
from experiments.servers.openigtlink.server import LinkSettings
from tests.experiments.servers.openigtlink import published
from tests.experiments.servers.openigtlink.connections import (
    SOON_S,
    awaited,
    connected,
    drained,
    feed_of,
    publish,
    served_client,
    serving,
    until,
    with_little_room,
)
from tests.experiments.servers.openigtlink.states import status_in


def needle(matrix: np.ndarray) -> bytes:
    """A needle's TRANSFORM."""
    return encode(Message("TRANSFORM", "NeedleTipToReference", pack_transform(matrix)))


NEEDLE = needle(np.eye(4))
NO_TRANSFORM = encode(Message("TRANSFORM", "NeedleTipToReference", bytes(47)))
POINT = pyigtl.PointMessage(positions=[[1.0, 2.0, 0.0]], device_name="F")


@awaited
async def test_pyigtl_receives_the_target_and_sends_needle_and_fix():
    feed, commands = feed_of()

    async def moments() -> None:
        while True:
            publish(feed)
            await asyncio.sleep(0.01)

    async with serving(feed) as port:
        client = pyigtl.OpenIGTLinkClient("127.0.0.1", port)
        publishing = asyncio.create_task(moments())
        try:
            target = await asyncio.to_thread(client.wait_for_message, "TargetToReference", SOON_S)
            said = await asyncio.to_thread(client.wait_for_message, "SoftaimState", SOON_S)
            pose = pyigtl.TransformMessage(np.eye(4), device_name="NeedleTipToReference")
            client.send_message(pose, wait=False)
            client.send_message(POINT, wait=False)
            await until(lambda: len(commands) >= 2)
        finally:
            publishing.cancel()
            await asyncio.to_thread(client.stop)
    assert target.matrix[:3, 3].tolist() == [1.5, -20.25, 0.0]
    assert target.metadata == {"TransformStatus": "OK"}
    assert json.loads(said.string)["advice"] == "GO"
    # the needle looks across the plane of this scene, and is refused: it is not seen
    assert commands == [UNSEEN, {"command": "fix", "place_mm": [1.0, 2.0]}]


@awaited
async def test_a_feed_that_says_nothing_is_stale_and_nothing_else_is_sent():
    """What was there before a server began is of unknown age, and is not sent either."""
    feed, _ = feed_of(stale_ms=50)
    publish(feed)
    async with serving(feed) as port, connected(port) as client:
        assert (await client.next()).type == "POLYDATA"
        for _ in range(3):
            message = await client.next()
            assert message.type == "STATUS"
            assert status_in(message) == (Code.TIME_OUT, "STALE")
        while (said := status_in(message)[1]) == "STALE":
            publish(feed)
            message = await client.until("Softaim")
        assert said == "TRACKING"
        while (message := await client.next()).type != "STATUS":
            pass
        assert status_in(message)[1] == "STALE"


@awaited
async def test_who_sends_the_needle_is_not_sent_it():
    """A program that has both under one name would move its own needle to where it was."""
    feed, commands = feed_of(dim=3)
    async with serving(feed) as port, connected(port) as tracker, connected(port) as viewer:
        await tracker.next()
        await viewer.next()
        tracker.writer.write(NEEDLE)
        await until(lambda: commands)
        publish(feed)
        publish(feed)
        await viewer.until("NeedleTipToReference")
        publish(feed)
        for _ in range(8):
            assert (await tracker.next()).device != "NeedleTipToReference"
            publish(feed)
    assert commands == [{"command": "needle", "tip_mm": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0]}]


@pytest.mark.parametrize("refused", [needle(1.03 * np.eye(4)), NO_TRANSFORM], ids=["scaled", "of another size"])
@awaited
async def test_a_needle_whose_next_pose_is_refused_is_not_seen(refused: bytes):
    async with served_client(dim=3) as (_, commands, client):
        client.writer.write(NEEDLE + refused)
        if refused is not NO_TRANSFORM:
            assert status_in(await client.until("SoftaimReply")) == (Code.ILLEGAL_INSTRUCTION, "REFUSED")
        await until(lambda: len(commands) >= 2)
    assert [command["command"] for command in commands] == ["needle", "needle_unseen"]


@awaited
async def test_one_too_many_is_notified_and_dropped_and_has_room_once_another_is_gone():
    feed, _ = feed_of()
    async with serving(feed, settings=LinkSettings(clients=2)) as port, connected(port) as first:
        async with connected(port) as second:
            for client in (first, second):
                assert (await client.next()).type == "POLYDATA"
            async with connected(port) as third:
                assert status_in(await third.next()) == (Code.BUSY, "REFUSED")
                assert await third.is_dropped()
        async with asyncio.timeout(SOON_S):
            while True:
                async with connected(port) as again:
                    if (await again.next()).type == "POLYDATA":
                        break
        publish(feed)
        assert (await first.next()).type == "TRANSFORM"


@pytest.mark.parametrize(
    "sent",
    [
        b"GET / HTTP/1.1\r\nHost: localhost:18944\r\n\r\n" + bytes(58),
        bytes(58),
        b"\xff" * 4096,
        published.TRANSFORM[:42] + b"\xff" * 8 + published.TRANSFORM[50:],
        published.TRANSFORM[:-1] + b"\0",
        NO_TRANSFORM,
        encode(Message("POINT", "F", bytes(137))),
        encode(Message("IMAGE", "N", bytes(65536))),
        None,
    ],
    ids=["http", "zeros", "ones", "size", "checksum", "transform", "point", "image", "half a message"],
)
@awaited
async def test_who_sends_what_is_no_message_is_dropped_and_nobody_else(sent: bytes | None):
    feed, commands = feed_of()
    async with serving(feed) as port, connected(port) as good, connected(port) as bad:
        await good.next()
        bad.writer.write(NEEDLE[:100] if sent is None else sent)
        if sent is None:
            bad.writer.write_eof()
        assert await bad.is_dropped()
        publish(feed)
        assert (await good.next()).device == "TargetToReference"
    assert commands == []


@awaited
async def test_a_message_that_comes_too_slowly_ends_the_connection():
    """A byte now and then does not help; between messages a client may be silent for as long as it likes."""
    feed, _ = feed_of()
    limits = LinkSettings(message_s=0.2)
    async with serving(feed, settings=limits) as port, connected(port) as silent, connected(port) as slow:

        async def drip() -> None:
            with contextlib.suppress(ConnectionError):
                for i in range(len(NEEDLE)):
                    slow.writer.write(NEEDLE[i : i + 1])
                    await slow.writer.drain()
                    await asyncio.sleep(0.05)

        dripping = asyncio.create_task(drip())
        assert await slow.is_dropped()
        dripping.cancel()
        await silent.next()
        publish(feed)
        assert (await silent.next()).type == "TRANSFORM"


@awaited
async def test_who_reads_nothing_is_dropped_and_holds_up_nobody():
    """Once it reads, after half a second, its connection comes to an end."""
    feed, _ = feed_of()
    async with serving(feed, settings=LinkSettings(stuck_s=0.1)) as port, connected(port) as good:
        with with_little_room(port) as stuck:
            await good.next()
            for _ in range(50):
                publish(feed)
                await good.until("NeedleTipToReference")
                await asyncio.sleep(0.01)
            assert await drained(stuck) > 0


@awaited
async def test_a_slow_client_loses_old_moments_and_gets_the_newest():
    """It reads a moment for every ten that are published: those it gets follow each other by more and more than one."""
    feed, _ = feed_of()
    async with serving(feed) as port, connected(port) as good:
        with with_little_room(port) as slow:
            await good.next()
            found = b""
            for number in range(600):
                publish(feed, marks_used=number)
                await good.until("NeedleTipToReference")
                if number % 10 == 0:
                    with contextlib.suppress(BlockingIOError):
                        found += slow.recv(917)
    # what each whole STRING in these bytes holds
    parts = [b'{"utc_s"' + part for part in found.split(b'{"utc_s"')[1:] if b"}" in part]
    marks = [json.loads(part[: part.index(b"}") + 1])["marks_used"] for part in parts]
    assert marks == sorted(set(marks))
    assert max(b - a for a, b in pairwise(marks)) > 5
    assert marks[-1] > 600 - 100


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "::ffff:127.0.0.1", "192.0.2.7"])
@awaited
async def test_commands_are_taken_from_this_machine_alone(host: str, monkeypatch):
    """The other end is taken to be where it says; one elsewhere gets an answer, and stays."""
    monkeypatch.setattr("experiments.servers.openigtlink.server._name", lambda _writer: host)
    async with served_client() as (feed, commands, client):
        client.writer.write(POINT.pack())
        if host == "192.0.2.7":
            assert status_in(await client.until("SoftaimReply")) == (Code.ACCESS_DENIED, "REFUSED")
        else:
            await until(lambda: commands)
        publish(feed)
        await client.until("TargetToReference")
    assert len(commands) == (host != "192.0.2.7")


@awaited
async def test_cancelled_it_closes_every_connection():
    feed, _ = feed_of()
    async with contextlib.AsyncExitStack() as clients:
        async with serving(feed) as port:
            found = [await clients.enter_async_context(connected(port)) for _ in range(3)]
            _ = [await client.next() for client in found]
        assert all([await client.is_dropped() for client in found])
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection("127.0.0.1", port)
    assert len(asyncio.all_tasks()) == 2
