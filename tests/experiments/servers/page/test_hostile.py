"""Hostile clients end their own connection and nothing else: at random, and one test of each bound."""

import socket
import time
from contextlib import suppress
from typing import BinaryIO

import pytest

from experiments.servers.page import bounded, serving
from tests.experiments.servers.page import messages
from tests.experiments.servers.page.fuzz import handshake, trial
from tests.experiments.servers.page.served import SOON_S, served


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """No limit of time ends a connection, but those that a test sets."""
    for module, name in ((bounded, "REQUESTS_S"), (bounded, "CLOSING_S"), (serving, "PING_S")):
        monkeypatch.setattr(module, name, 3600.0)
    return monkeypatch


def ended(raw: socket.socket, within_s: float) -> bool:
    """Whether the other side ends a connection in that time."""
    raw.settimeout(within_s)
    try:
        while raw.recv(1 << 20):
            pass
    except TimeoutError:
        return False
    except OSError:
        return True
    return True


def test_thousands_of_hostile_messages_hold_up_nobody_and_fill_no_log(caplog: pytest.LogCaptureFixture) -> None:
    found = trial(600, 1)
    assert found["sent"] >= 600
    assert found["longest_work_ms"] < 2000.0
    assert found["grown_mb"] < 50.0
    assert [record.getMessage() for record in caplog.records if record.name != "softaim"] == []


@pytest.mark.usefixtures("patient")
def test_an_endless_message_of_empty_frames_is_ended() -> None:
    with served(messages.scene()) as one, handshake(one) as raw:
        with suppress(OSError):  # ended while it was sent
            raw.sendall(b"\x01\x80abcd" + b"\x00\x80abcd" * 10 * bounded.MOST_PIECES)
        assert ended(raw, SOON_S)


def test_who_sends_a_request_bit_by_bit_is_ended(patient: pytest.MonkeyPatch) -> None:
    patient.setattr(bounded, "REQUESTS_S", 0.3)
    began = time.monotonic()
    with served(messages.scene()) as one, socket.create_connection(("127.0.0.1", one.port)) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\n")
        assert ended(raw, SOON_S)
    assert time.monotonic() - began > 0.3


def test_a_handshake_that_is_none_is_ended(patient: pytest.MonkeyPatch) -> None:
    patient.setattr(bounded, "CLOSING_S", 0.3)
    with served(messages.scene()) as one, socket.create_connection(("127.0.0.1", one.port)) as raw:
        fields = b"".join(b"X-%d: 1\r\n" % k for k in range(200))  # more than the WebSocket's library reads
        host = b"Host: 127.0.0.1:%d\r\n" % one.port
        raw.sendall(
            b"GET /stream HTTP/1.1\r\n" + host + b"Upgrade: websocket\r\nConnection: Upgrade\r\n" + fields + b"\r\n"
        )
        assert ended(raw, SOON_S)


def test_connections_beyond_the_most_are_ended_at_once(patient: pytest.MonkeyPatch) -> None:
    patient.setattr(bounded, "MOST_CONNECTIONS", 3)
    with served(messages.scene()) as one:
        held = [socket.create_connection(("127.0.0.1", one.port)) for _ in range(3)]
        with socket.create_connection(("127.0.0.1", one.port)) as more:
            assert ended(more, SOON_S)
        assert not ended(held[0], 0.1)
        for raw in held:
            raw.close()


def head(port: int, n_bytes: int) -> bytes:
    """A request for the page whose head is so long."""
    begin = b"GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nX-Long: " % port
    return begin + b"a" * (n_bytes - len(begin) - 4) + b"\r\n\r\n"


@pytest.mark.parametrize(
    ("n_before", "n_bytes", "taken"),
    [
        *[(0, 16_384, True), (0, 16_385, False), (0, 250_000, False)],
        *[(200, 16_384, True), (200, 16_385, False)],
    ],
)
def test_a_head_of_more_than_16_kib_is_refused(n_before: int, n_bytes: int, taken: bool) -> None:
    """However it comes: at once, or together with another request on the same connection."""
    with served(messages.scene()) as one:
        sent = (head(one.port, n_before) if n_before else b"") + head(one.port, n_bytes)
        with socket.create_connection(("127.0.0.1", one.port), timeout=20.0) as raw, raw.makefile("rb") as answers:
            with suppress(OSError):  # ended while it was sent
                raw.sendall(sent)
            if n_before:
                assert answered(answers) == b"200"
            assert answered(answers) in ([b"200"] if taken else [b"400", b""])


def answered(answers: BinaryIO) -> bytes:
    """The status of the next answer, which is read whole; nothing where the connection ended with what was unread."""
    try:
        status, length = answers.readline().split()[1], 0
    except ConnectionResetError:
        return b""
    while (line := answers.readline().strip()) != b"":
        name, _, value = line.partition(b":")
        length = int(value) if name.lower() == b"content-length" else length
    answers.read(length)
    return status
