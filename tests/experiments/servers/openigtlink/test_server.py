"""The server on the loopback: its clients are pyigtl, and sockets that behave as no client should."""

import json
import socket
import time
from contextlib import ExitStack, suppress
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
from tests.experiments.servers.openigtlink.connections import Client, serving, state, status_in, with_little_room
from tests.experiments.servers.page.served import SOON_S, Served


def needle(matrix: np.ndarray) -> bytes:
    """A needle's TRANSFORM."""
    return encode(Message("TRANSFORM", "NeedleTipToReference", pack_transform(matrix)))


NEEDLE = needle(np.eye(4))
NO_TRANSFORM = encode(Message("TRANSFORM", "NeedleTipToReference", bytes(47)))
POINT = pyigtl.PointMessage(positions=[[1.0, 2.0, 0.0]], device_name="F")


def test_pyigtl_receives_the_target_and_sends_needle_and_fix():
    with serving() as one:
        client = pyigtl.OpenIGTLinkClient("127.0.0.1", one.port)
        try:

            def came(device: str) -> pyigtl.messages.MessageBase | None:
                one.publish(state())
                return client.wait_for_message(device, 0.01)

            found = {}
            for device in ("TargetToReference", "SoftaimState"):
                one.until(lambda device=device: found.update({device: came(device)}) or found[device])
            client.send_message(pyigtl.TransformMessage(np.eye(4), device_name="NeedleTipToReference"), wait=False)
            client.send_message(POINT, wait=False)
            one.until(lambda: len(one.commands) >= 2)
        finally:
            client.stop()
    assert found["TargetToReference"].matrix[:3, 3].tolist() == [1.5, -20.25, 0.0]
    assert found["TargetToReference"].metadata == {"TransformStatus": "OK"}
    assert json.loads(found["SoftaimState"].string)["advice"] == "GO"
    # the needle looks across the plane of this scene, and is refused: it is not seen
    assert one.commands == [UNSEEN, {"command": "fix", "place_mm": [1.0, 2.0]}]


def test_a_feed_that_says_nothing_is_stale_and_nothing_else_is_sent():
    """What was there before a server began is of unknown age, and is not sent either."""
    with serving(stale_ms=50) as one, Client(one) as client:
        assert client.next().type == "POLYDATA"
        for _ in range(3):
            message = client.next()
            assert message.type == "STATUS"
            assert status_in(message) == (Code.TIME_OUT, "STALE")
        while (said := status_in(message)[1]) == "STALE":
            one.publish(state())
            message = client.until("Softaim")
        assert said == "TRACKING"
        while (message := client.next()).type != "STATUS":
            pass
        assert status_in(message)[1] == "STALE"


def test_who_sends_the_needle_is_not_sent_it():
    """A program that has both under one name would move its own needle to where it was."""
    with serving(dim=3) as one, Client(one) as tracker, Client(one) as viewer:
        tracker.next()
        viewer.next()
        tracker.socket.sendall(NEEDLE)
        one.until(lambda: one.commands)
        one.publish(state())
        one.publish(state())
        viewer.until("NeedleTipToReference")
        one.publish(state())
        for _ in range(8):
            assert tracker.next().device != "NeedleTipToReference"
            one.publish(state())
    assert one.commands == [{"command": "needle", "tip_mm": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0]}]


@pytest.mark.parametrize("refused", [needle(1.03 * np.eye(4)), NO_TRANSFORM], ids=["scaled", "of another size"])
def test_a_needle_whose_next_pose_is_refused_is_not_seen(refused: bytes):
    with serving(dim=3) as one, Client(one) as client:
        client.next()
        client.socket.sendall(NEEDLE + refused)
        if refused is not NO_TRANSFORM:
            assert status_in(client.until("SoftaimReply")) == (Code.ILLEGAL_INSTRUCTION, "REFUSED")
        one.until(lambda: len(one.commands) >= 2)
    assert [command["command"] for command in one.commands] == ["needle", "needle_unseen"]


def test_one_too_many_is_notified_and_dropped_and_has_room_once_another_is_gone():
    def has_room(one: Served) -> bool:
        with Client(one) as again:
            return again.next().type == "POLYDATA"

    with serving(LinkSettings(clients=2)) as one, Client(one) as first:
        with Client(one) as second:
            for client in (first, second):
                assert client.next().type == "POLYDATA"
            with Client(one) as third:
                assert status_in(third.next()) == (Code.BUSY, "REFUSED")
                assert third.is_dropped()
        one.until(lambda: has_room(one))
        one.publish(state())
        assert first.next().type == "TRANSFORM"


@pytest.mark.parametrize(
    "sent",
    [
        b"GET / HTTP/1.1\r\nHost: localhost:18944\r\n\r\n" + bytes(58),
        published.TRANSFORM[:-1] + b"\0",
        NO_TRANSFORM,
        None,
    ],
    ids=["http", "checksum", "transform", "half a message"],
)
def test_who_sends_what_is_no_message_is_dropped_and_nobody_else(sent: bytes | None):
    with serving() as one, Client(one) as good, Client(one) as bad:
        good.next()
        bad.socket.sendall(NEEDLE[:100] if sent is None else sent)
        if sent is None:
            bad.socket.shutdown(socket.SHUT_WR)
        assert bad.is_dropped()
        one.publish(state())
        assert good.next().device == "TargetToReference"
    assert one.commands == []


def test_a_message_that_comes_too_slowly_ends_the_connection():
    """A byte now and then does not help; between messages a client may be silent for as long as it likes."""
    with serving(LinkSettings(message_s=0.2)) as one, Client(one) as silent, Client(one) as slow:
        with suppress(ConnectionError):
            for byte in NEEDLE[:20]:
                slow.socket.sendall(bytes([byte]))
                time.sleep(0.05)
        assert slow.is_dropped()
        silent.next()
        one.publish(state())
        assert silent.next().type == "TRANSFORM"


def test_who_reads_nothing_is_dropped_and_holds_up_nobody():
    """Once it reads, after half a second, its connection comes to an end."""
    with serving(LinkSettings(stuck_s=0.1)) as one, Client(one) as good, with_little_room(one) as stuck:
        good.next()
        for _ in range(50):
            one.publish(state())
            good.until("NeedleTipToReference")
            time.sleep(0.01)
        stuck.settimeout(SOON_S)
        n_bytes = 0
        with suppress(ConnectionResetError):
            while piece := stuck.recv(65536):
                n_bytes += len(piece)
        assert n_bytes > 0


def test_a_slow_client_loses_old_moments_and_gets_the_newest():
    """It reads a moment for every ten that are published: those it gets follow each other by more and more than one."""
    with serving() as one, Client(one) as good, with_little_room(one) as slow:
        good.next()
        found = b""
        for number in range(600):
            one.publish(state(marks_used=number))
            good.until("NeedleTipToReference")
            if number % 10 == 0:
                with suppress(BlockingIOError):
                    found += slow.recv(917)
    # what each whole STRING in these bytes holds
    parts = [b'{"utc_s"' + part for part in found.split(b'{"utc_s"')[1:] if b"}" in part]
    marks = [json.loads(part[: part.index(b"}") + 1])["marks_used"] for part in parts]
    assert marks == sorted(set(marks))
    assert max(b - a for a, b in pairwise(marks)) > 5
    assert marks[-1] > 600 - 100


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "::ffff:127.0.0.1", "192.0.2.7"])
def test_commands_are_taken_from_this_machine_alone(host: str, monkeypatch):
    """The other end is taken to be where it says; one elsewhere gets an answer, and stays."""
    monkeypatch.setattr("experiments.servers.openigtlink.server._name", lambda _writer: host)
    with serving() as one, Client(one) as client:
        client.next()
        client.socket.sendall(POINT.pack())
        if host == "192.0.2.7":
            assert status_in(client.until("SoftaimReply")) == (Code.ACCESS_DENIED, "REFUSED")
        else:
            one.until(lambda: one.commands)
        one.publish(state())
        client.until("TargetToReference")
    assert len(one.commands) == (host != "192.0.2.7")


def test_cancelled_it_closes_every_connection():
    with ExitStack() as clients:
        with serving() as one:
            found = [clients.enter_context(Client(one)) for _ in range(3)]
            _ = [client.next() for client in found]
        assert all(client.is_dropped() for client in found)
        with pytest.raises(ConnectionRefusedError):
            Client(one)
