"""The stream: scene, states, pictures, commands; the newest only; as many clients as agreed, none that harms others."""

import asyncio
import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from typing import Any

import pytest
from starlette.websockets import WebSocket
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from experiments.servers.feed import Feed
from experiments.servers.page.stream import Viewer
from tests.experiments.servers.page import messages
from tests.experiments.servers.page.served import SOON_S, TOKEN, Served, served
from tests.experiments.servers.page.test_access import ended, stream


@pytest.fixture
def one() -> Iterator[Served]:
    with served(messages.scene()) as serving:
        yield serving


@pytest.fixture
def writing(one: Served) -> Iterator[ClientConnection]:
    """A client that may write, and has the scene."""
    with stream(one, TOKEN) as client:
        client.recv(SOON_S)
        yield client


def asked(client: ClientConnection, text: str) -> dict[str, Any]:
    """The answer to what a client sends."""
    client.send(text)
    return json.loads(client.recv(SOON_S))


def test_scene_then_each_newest_state_and_its_picture_right_after(one: Served) -> None:
    with stream(one, query="?pictures=1") as client:
        assert json.loads(client.recv(SOON_S)) == {**json.loads(json.dumps(messages.scene())), "may_write": False}
        one.until(lambda: one.feed.n_watching == 1)
        for frames in (1, 2):
            one.publish(messages.state(frames), messages.picture())
            assert json.loads(client.recv(SOON_S))["counters"]["frames"] == frames
            assert client.recv(SOON_S) == messages.picture()
        one.publish(messages.state(3))
        assert json.loads(client.recv(SOON_S))["counters"]["frames"] == 3
    one.until(lambda: one.feed.n_watching == 0)


@pytest.mark.parametrize("taken", [1, 2])
def test_who_is_gone_while_a_state_and_an_answer_are_sent_ends_without_a_fault(taken: int) -> None:
    """Whichever comes second finds the connection closed by the first, which starlette calls another fault."""

    async def receive() -> dict[str, str]:
        return {"type": "websocket.receive", "text": "{}"} if reported else {"type": "websocket.connect"}

    async def send(message: Mapping[str, Any]) -> None:
        reported.append(message)
        await asyncio.sleep(0.0)
        if len(reported) > taken:
            raise OSError("gone")

    async def watched() -> None:
        feed = Feed(messages.scene())
        feed.publish(b"{}", None)
        socket = WebSocket({"type": "websocket", "query_string": b"", "headers": []}, receive, send)
        await socket.accept()
        await asyncio.wait_for(Viewer(socket, feed, may_write=False).serve(), SOON_S)

    reported: list[Mapping[str, Any]] = []
    asyncio.run(watched())
    assert len(reported) == taken + 1


def test_a_client_that_sets_its_pace_gets_the_newest_when_it_is_ready(one: Served) -> None:
    with stream(one, query="?pace=1") as client:
        client.recv(SOON_S)
        one.publish(messages.state(1))
        assert json.loads(client.recv(SOON_S))["counters"]["frames"] == 1
        for frames in range(2, 10):
            one.publish(messages.state(frames))
        with pytest.raises(TimeoutError):
            client.recv(0.1)
        client.send("next")
        assert json.loads(client.recv(SOON_S))["counters"]["frames"] == 9


def test_who_does_not_read_neither_holds_up_others_nor_fills_memory(one: Served) -> None:
    padding = bytes(500_000)
    with stream(one, query="?pictures=1") as slow, stream(one) as other:
        for client in (slow, other):
            client.recv(SOON_S)
        one.until(lambda: one.feed.n_watching == 1)  # the other asked for none
        n_published = 400
        for frames in range(1, n_published + 1):
            one.publish(messages.state(frames), padding)
            assert json.loads(other.recv(SOON_S))["counters"]["frames"] == frames
        got = [json.loads(slow.recv(SOON_S))["counters"]["frames"]]
        while got[-1] < n_published:
            message = slow.recv(SOON_S)
            got += [json.loads(message)["counters"]["frames"]] if isinstance(message, str) else []
        # What was not taken was left out: 200 MB were published
        assert len(got) < n_published / 2


def test_sixteen_clients_and_no_more(one: Served) -> None:
    with ExitStack() as stack:
        clients = [stack.enter_context(stream(one)) for _ in range(16)]
        for client in clients:
            client.recv(SOON_S)
        with stream(one) as more:
            assert ended(more) == 1013
        clients[0].close()
        one.until(lambda: accepted(one))


def accepted(one: Served) -> bool:
    with stream(one) as client:
        try:
            return bool(client.recv(SOON_S))
        except ConnectionClosed:
            return False


NO_COMMANDS = ['{"command": "fly"}', '{"command": "fix", "place_px": [1]}', '{"command": "' + "x" * 60_000 + '"}']


@pytest.mark.parametrize("text", ["", "{", "null", "[]", "1", "[" * 10_000, *NO_COMMANDS], ids=lambda text: text[:30])
def test_what_is_no_command_is_refused_in_one_line(one: Served, writing: ClientConnection, text: str) -> None:
    found = asked(writing, text)
    assert found["type"] == "answer"
    assert 0 < len(found["error"]) <= 200
    assert one.commands == []


@pytest.mark.parametrize(
    "refused",
    [
        '{"command": "needle"}',
        '{"command": "needle", "tip_mm": [1, 2], "direction": [0, null]}',
        '{"command": "needle", "tip_mm": [1, 2, 3, 4], "direction": [0, 0, 1]}',
        '{"command": "needle", "tip_mm": [1, 20000], "direction": [0, 1]}',
    ],
)
def test_a_needle_whose_pose_is_refused_is_not_seen(one: Served, writing: ClientConnection, refused: str) -> None:
    assert asked(writing, '{"command": "needle", "tip_mm": [1, 2], "direction": [0, 1]}')["error"] is None
    assert asked(writing, refused)["error"]
    assert [command["command"] for command in one.commands] == ["needle", "needle_unseen"]


def test_what_the_run_refuses_is_reported(one: Served, writing: ClientConnection) -> None:
    one.refusal = "recording: the disk is full"
    found = asked(writing, '{"command": "record", "on": true}')
    assert found == {"type": "answer", "command": "record", "error": "recording: the disk is full"}


@pytest.mark.parametrize(("message", "code"), [("x" * 65_537, 1009), (b"binary", 1003)])
def test_too_much_and_binary_end_the_connection_alone(one, writing, message: str | bytes, code: int) -> None:
    writing.send(message)
    assert ended(writing) == code
    assert accepted(one)


def test_clients_are_notified_when_the_server_ends() -> None:
    with ExitStack() as stack:
        with served(messages.scene()) as one:
            client = stack.enter_context(stream(one))
            client.recv(SOON_S)
        assert ended(client) == 1012
