"""The page and the stream as one application: plain files, the schema, and a WebSocket."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute

from experiments.servers.feed import Feed
from experiments.servers.page.access import Access, Guard
from experiments.servers.page.stream import Stream

STATIC = Path(__file__).parent / "static"
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/schema+json",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}


def application(feed: Feed, *, hosts: Iterable[str], token: str, read_open: bool) -> Starlette:
    """The page at `/`, its files beside it, and the stream at `/stream`.

    hosts: exact names of the server, `address:port`; requests for other names are refused
    token: secret that clients need to write, and, if `read_open` is false, also to read
    """
    access = Access(frozenset(host.lower() for host in hosts), token, read_open)
    # all files are in memory, so that paths in requests never reach the disk
    files = {path.relative_to(STATIC).as_posix(): path for path in sorted(STATIC.rglob("*")) if path.suffix in KINDS}
    held = {name: (path.read_bytes(), KINDS[path.suffix]) for name, path in files.items()}

    async def file(request: Request) -> Response:
        content, kind = held.get(request.path_params["name"] or "index.html", (None, ""))
        if content is None:
            return PlainTextResponse("not found\n", 404)
        return Response(content, media_type=kind)

    return Starlette(
        routes=[WebSocketRoute("/stream", Stream(feed, access).serve), Route("/{name:path}", file)],
        middleware=[Middleware(Guard, access=access)],
    )
