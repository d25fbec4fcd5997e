"""The process that serves a run: started, fed, asked by a client, killed."""

import json
import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
import pytest
from pyigtl.messages import PointMessage

from experiments.errors import InputError
from experiments.servers.faces import LOOPBACK, Faces, address_of, is_loopback, listening, names_of, usual
from experiments.servers.link import MOST_REQUESTS, Link, jpeg, text_of
from experiments.servers.opening import served
from tests.experiments.servers.openigtlink.connections import SCENE, state
from tests.experiments.waiting import until

STARTS_S = 120.0
"""For a process that imports, or ends, on a busy machine."""


@contextmanager
def linked() -> Iterator[tuple[Link, int]]:
    """A link whose process serves OpenIGTLink, and the port; it has as long to end as it takes on a busy machine."""
    listener = usual(0)
    port = listener.getsockname()[1]
    link = Link(Faces(openigtlink=listener), ["served"])
    listener.close()
    try:
        yield link, port
    finally:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("experiments.servers.link.ENDS_S", STARTS_S)
            link.close()


@pytest.mark.slow
def test_a_client_is_sent_what_the_loop_publishes_and_the_loop_gets_what_it_asks(capfd):
    """A moment is published until it came; then a sighting of the target goes the other way. The process ends, too."""
    with linked() as (link, port):
        link.begin(SCENE)
        link.tell()
        link.tell()
        with socket.create_connection((LOOPBACK, port), STARTS_S) as client:
            client.settimeout(0.05)

            def came() -> bool:
                link.publish(lambda: state(sigma_mm=float("nan")), None)
                try:
                    return b"TargetToReference" in client.recv(1 << 16)
                except TimeoutError:
                    return False

            until(came, STARTS_S)
            client.sendall(PointMessage(positions=[(1.0, 2.0, 0.0)], names=["lesion"], device_name="F").pack())
            asked: list[object] = []
            until(lambda: asked.extend(link.requests()) or asked, STARTS_S)
    assert link._process.exitcode == 0
    assert asked[0]["command"] == "fix"  # type: ignore[index]
    assert asked[0]["place_mm"] == [1.0, 2.0]  # type: ignore[index]
    assert capfd.readouterr().err == "served\n"


@pytest.mark.slow
def test_the_loop_goes_on_when_the_process_is_killed(capfd):
    """It is said once, and publishing costs as little as before: no picture is compressed."""
    with linked() as (link, port):
        link.begin(SCENE)
        until(lambda: link._ready, STARTS_S)
        pid = link._process.pid
        os.kill(pid, signal.SIGKILL)
        until(lambda: link._ended, STARTS_S)
        began = time.process_time()
        for _ in range(1000):
            link.publish(state, np.zeros((480, 640, 3), np.uint8))
        assert time.process_time() - began < 1.0
        with pytest.raises(OSError, match="refused"):
            socket.create_connection((LOOPBACK, port), 1.0)
    assert capfd.readouterr().err.count("the process of page and network ended") == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a signal to a process")
def test_the_process_leaves_its_end_to_the_run_when_all_processes_are_terminated(capfd):
    with linked() as (link, _port):
        link.begin(SCENE)
        until(lambda: link._ready, STARTS_S)
        os.kill(link._process.pid, signal.SIGTERM)
    assert link._process.exitcode == 0
    assert capfd.readouterr().err == ""


def test_many_positions_of_a_needle_leave_room_for_other_requests(caplog):
    """Before the first estimate no request is taken, but a tracker may already send."""
    with linked() as (link, _port):
        link._process.kill()  # what clients send needs no process here
        poses = [{"command": "needle", "tip_mm": [float(k), 0.0], "direction": [0.0, 1.0]} for k in range(200)]
        for one in (*poses, {"command": "reset"}, poses[0]):
            link._add(one)
        assert list(link.requests()) == [poses[-1], {"command": "reset"}, poses[0]]
        for _ in range(MOST_REQUESTS + 2):
            link._add({"command": "reset"})
        assert len(list(link.requests())) == MOST_REQUESTS
    refused = [one.getMessage() for one in caplog.records if "not done" in one.getMessage()]
    assert refused == [f"not done: {n} requests, because {MOST_REQUESTS} others waited" for n in (1, 2)]


def test_numbers_that_json_cannot_hold_are_null():
    found = json.loads(text_of({"a": [float("nan"), {"b": float("inf")}], "c": 1.5}))
    assert found == {"a": [None, {"b": None}], "c": 1.5}


def test_a_picture_is_sent_as_jpeg():
    image = np.full((48, 64, 3), (30, 60, 200), np.uint8)
    decoded = cv2.imdecode(np.frombuffer(jpeg(image), np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(decoded.astype(int) - image).max() <= 3


@pytest.mark.parametrize(
    ("address", "message"),
    [("nowhere:port", "HOST:PORT"), ("127.0.0.1:70000", "up to 65535"), ("203.0.113.7:80", "a free address, found")],
)
def test_an_address_that_cannot_be_had_is_one_line(address, message):
    with pytest.raises(InputError, match=message):
        listening("--page", address, 8765)


def test_a_port_that_is_taken_is_one_line_where_it_was_asked_for_and_another_where_not():
    with usual(0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match="in use"):
            listening("--page", f"{LOOPBACK}:{port}", 8765)
        with usual(port) as other:
            assert other.getsockname()[0] == LOOPBACK
            assert other.getsockname()[1] != port
            assert is_loopback(other)


def test_a_port_alone_is_on_loopback_and_a_host_alone_at_the_usual_port():
    with listening("--page", "0", None) as one:
        assert is_loopback(one)
    with usual(0) as free:
        port = free.getsockname()[1]
    with listening("--page", LOOPBACK, port) as one:
        assert one.getsockname() == (LOOPBACK, port)
    with listening("--page", "0.0.0.0:0", None) as one:
        assert not is_loopback(one)
        assert address_of(one) in names_of(one)
        assert not address_of(one).startswith("0.0.0.0")


def test_at_port_80_a_browser_names_no_port():
    try:
        one = listening("--page", f"{LOOPBACK}:80", None)
    except InputError as fault:
        pytest.skip(str(fault))
    with one:
        assert set(names_of(one)) == {"127.0.0.1:80", "localhost:80", "127.0.0.1", "localhost"}


def test_nothing_is_served_where_nothing_is_wanted():
    with served(None, None, with_page=False) as link:
        assert link is None
