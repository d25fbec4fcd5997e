"""Who may read and write: exact Host and Origin on HTTP and WebSocket alike, and the token, by real sockets."""

import http.client
import json
from collections.abc import Iterator

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tests.experiments.servers.page import messages
from tests.experiments.servers.page.served import SOON_S, TOKEN, Served, served


@pytest.fixture(scope="module")
def one() -> Iterator[Served]:
    with served(messages.scene()) as serving:
        yield serving


@pytest.fixture(scope="module")
def closed() -> Iterator[Served]:
    """As off the loopback: to read needs the token, too."""
    with served(messages.scene(), read_open=False) as serving:
        yield serving


def answer(
    one: Served, method: str = "GET", path: str = "/", body: bytes | None = None, **headers: str
) -> http.client.HTTPResponse:
    """The answer to a request with these headers, read whole."""
    connection = http.client.HTTPConnection("127.0.0.1", one.port, timeout=SOON_S)
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    found = connection.getresponse()
    found.body = found.read()  # type: ignore[attr-defined]
    connection.close()
    return found


def stream(one: Served, *tokens: str, query: str = "", **headers: str) -> ClientConnection:
    """A client of the stream."""
    return connect(
        f"ws://127.0.0.1:{one.port}/stream{query}",
        subprotocols=["softaim.v1", *(f"token.{token}" for token in tokens)],  # type: ignore[list-item]
        additional_headers=headers,
        proxy=None,
        open_timeout=SOON_S,
    )


def ended(client: ClientConnection) -> int:
    """The code with which the server ends a client's connection."""
    with pytest.raises(ConnectionClosed) as caught:
        client.recv(SOON_S)
    return caught.value.rcvd.code


@pytest.mark.parametrize("name", ["127.0.0.1:{port}", "LOCALHOST:{port}"])
def test_own_hosts_are_answered(one: Served, name: str) -> None:
    assert answer(one, Host=name.format(port=one.port)).status == 200


@pytest.mark.parametrize(
    "name", ["evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "[::1]:{port}", "localhost.evil.example:{port}", ""]
)
def test_other_hosts_are_refused_so_that_no_name_can_be_rebound(one: Served, name: str) -> None:
    assert answer(one, Host=name.format(port=one.port)).status in {400, 403}


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://localhost:{port}"],
)
def test_other_origins_are_refused_on_http_and_websocket(one: Served, origin: str) -> None:
    assert answer(one, Origin=origin.format(port=one.port)).status == 403
    with pytest.raises(InvalidStatus) as caught:
        stream(one, TOKEN, Origin=origin.format(port=one.port))
    assert caught.value.response.status_code == 403


def test_own_origin_is_answered_on_http_and_websocket(one: Served) -> None:
    assert answer(one, Origin=f"http://127.0.0.1:{one.port}").status == 200
    with stream(one, Origin=f"http://127.0.0.1:{one.port}") as client:
        assert json.loads(client.recv(SOON_S))["type"] == "scene"


def test_every_answer_has_the_headers(one: Served) -> None:
    for path, status in (("/", 200), ("/main.js", 200), ("/schema.json", 200), ("/none", 404)):
        found = answer(one, path=path)
        assert found.status == status
        policy = found.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert f"ws://127.0.0.1:{one.port}" in policy
        assert found.headers["x-content-type-options"] == "nosniff"
        assert found.headers["referrer-policy"] == "no-referrer"
        assert found.headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    "path", ["/../application.py", "/%2e%2e/application.py", "/uplot/../../stream.py", "//etc/passwd", "/static/"]
)
def test_files_outside_are_not_there(one: Served, path: str) -> None:
    assert answer(one, path=path).status == 404


@pytest.mark.parametrize("method", ["POST", "TRACE"])
def test_only_reading_methods_are_answered(one: Served, method: str) -> None:
    assert answer(one, method).status == 405


def test_a_body_is_refused_before_it_comes(one: Served) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", one.port, timeout=SOON_S)
    connection.putrequest("GET", "/")
    connection.putheader("Content-Length", str(10**12))
    connection.endheaders()
    assert connection.getresponse().status == 413
    connection.close()


def test_no_token_reads_where_all_may_but_does_not_write(one: Served) -> None:
    with stream(one) as client:
        assert json.loads(client.recv(SOON_S))["may_write"] is False
        client.send('{"command": "reset"}')
        assert "token" in json.loads(client.recv(SOON_S))["error"]
    assert one.commands == []


def test_the_token_writes(one: Served) -> None:
    with stream(one, TOKEN) as client:
        assert json.loads(client.recv(SOON_S))["may_write"] is True
        client.send('{"command": "pause", "on": true}')
        assert json.loads(client.recv(SOON_S)) == {"type": "answer", "command": "pause", "error": None}
    assert one.commands == [{"command": "pause", "on": True}]
    one.commands.clear()


@pytest.mark.parametrize("tokens", [("wrong",), (TOKEN[:-1],), ("",), (TOKEN, "wrong")])
def test_a_wrong_token_reads_nothing_anywhere(one: Served, closed: Served, tokens: tuple[str, ...]) -> None:
    for serving in (one, closed):
        with stream(serving, *tokens) as client:
            assert ended(client) == 4401


def test_off_the_loopback_reading_needs_the_token(closed: Served) -> None:
    with stream(closed) as client:
        assert ended(client) == 4401
    with stream(closed, TOKEN) as client:
        assert json.loads(client.recv(SOON_S))["type"] == "scene"
