"""Opens the listening sockets of a live run's servers, and starts the process that serves clients."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager

from experiments.extras import missing, needed, require
from experiments.log import LOG
from experiments.servers.faces import IGTL_PORT, PAGE_PORT, Faces, address_of, is_loopback, listening, usual
from experiments.servers.link import Link


@contextmanager
def served(page: str | None, openigtlink: str | None, *, with_page: bool = True) -> Iterator[Link | None]:
    """Serve a page and OpenIGTLink in another process until the context ends; yields the link to that process.

    If there is nothing to serve, it yields None. Raises InputError if an address is not available.
    page, openigtlink: addresses as HOST:PORT; if `openigtlink` is None, OpenIGTLink is not served
    with_page: whether to serve a page; without an address, it is on loopback at the default port or at any free port
    """
    lacking = missing("live")
    if page is not None:
        require("--page", "live")
    if with_page and lacking:
        LOG.warning("no page: it needs %s", needed("live"))
    igtl = None if openigtlink is None else listening("--openigtlink", openigtlink, IGTL_PORT)
    listener = None
    if with_page and not lacking:
        listener = usual(PAGE_PORT) if page is None else listening("--page", page, PAGE_PORT)
    if listener is None and igtl is None:
        yield None
        return
    token = secrets.token_urlsafe(16)
    notices = []
    if listener is not None:
        notices.append(f"page: http://{address_of(listener)}/#token={token}")
    if igtl is not None:
        notices.append(f"OpenIGTLink: {address_of(igtl)}")
    link = Link(Faces(listener, igtl, token, read_open=listener is None or is_loopback(listener)), notices)
    for one in (listener, igtl):
        if one is not None:
            one.close()  # the process has its own copies of the sockets
    try:
        yield link
    finally:
        link.close()
