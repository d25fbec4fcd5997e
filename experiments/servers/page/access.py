"""Access rights: a token, and checks of the headers Host and Origin against pages of other sites and DNS rebinding.

`Guard` wraps the application, so that refused requests do not reach it.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from dataclasses import dataclass

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

PROTOCOL = "softaim.v1"
TOKEN_PREFIX = "token."
"""Prefix of the token. A client sends the token as a subprotocol, because a browser can set no other header."""


@dataclass(frozen=True, slots=True)
class Access:
    """Access rules for clients.

    hosts: allowed values of Host, `address:port`, in lower case
    token: secret that clients need to write, and, if `read_open` is false, also to read
    """

    hosts: frozenset[str]
    token: str
    read_open: bool

    def knows_place(self, headers: Headers) -> bool:
        """Whether a request has exactly one Host, an allowed one, and no Origin other than this page."""
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0].lower() not in self.hosts:
            return False
        # programs send no Origin; a browser sends it with every WebSocket, and no page can change it
        return not origins or origins == [f"http://{hosts[0].lower()}"]

    def grant(self, subprotocols: Iterable[str]) -> tuple[bool, bool]:
        """Whether a client may read, and whether it may write. The client sends the token as a subprotocol."""
        tokens = [one.removeprefix(TOKEN_PREFIX) for one in subprotocols if one.startswith(TOKEN_PREFIX)]
        if not tokens:
            return self.read_open, False
        # a page with a wrong token may not read even if reading is open: it belongs to another run and must report that
        known = len(tokens) == 1 and secrets.compare_digest(tokens[0].encode(), self.token.encode())
        return known, known


class Guard:
    """Wraps an application; refuses wrong hosts and origins, methods except GET and HEAD, and requests with a body.

    Every answer gets headers that forbid framing, caching, sniffing of content types, and content from other hosts.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it. Its body is never read."""
        headers = Headers(scope=scope)
        if not self._access.knows_place(headers):
            if scope["type"] == "websocket":
                await send({"type": "websocket.close"})  # a WebSocket closed before it is accepted is answered with 403
            else:
                await self._refuse(403, "wrong Host or Origin")(scope, receive, send)
            return
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
            return

        async def send_safely(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message["headers"], *_headers(headers["host"].lower())]}
            await send(message)

        answer = self._app
        if scope["method"] not in {"GET", "HEAD"}:
            answer = self._refuse(405, "only GET and HEAD", allow="GET, HEAD")
        elif headers.get("content-length", "0") != "0" or "transfer-encoding" in headers:
            answer = self._refuse(413, "no body")
        await answer(scope, receive, send_safely)

    @staticmethod
    def _refuse(status: int, why: str, **headers: str) -> ASGIApp:
        """Refuse a request; the connection ends with the answer, and further input is not read."""
        return PlainTextResponse(f"{why}\n", status, {"connection": "close", **headers})


def _headers(host: str) -> list[tuple[bytes, bytes]]:
    """Headers of every answer; host: an allowed host."""
    policy = [
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self'",
        f"connect-src 'self' ws://{host}",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    ]
    return [
        (b"content-security-policy", "; ".join(policy).encode()),
        (b"x-content-type-options", b"nosniff"),
        (b"x-frame-options", b"DENY"),
        (b"referrer-policy", b"no-referrer"),
        (b"cache-control", b"no-store"),
        (b"cross-origin-resource-policy", b"same-origin"),
        (b"cross-origin-opener-policy", b"same-origin"),
    ]
