"""Addresses of a live run's servers, and their listening sockets."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass

from experiments.errors import InputError, shown

LOOPBACK = "127.0.0.1"
PAGE_PORT, IGTL_PORT = 8765, 18944
"""Default port of the page, and the registered port of OpenIGTLink."""
BACKLOG = 32


@dataclass(frozen=True, slots=True)
class Faces:
    """Listening sockets of a run's servers; None for a server that does not run.

    token: secret that clients need to write; read_open: whether clients without the token may read
    """

    page: socket.socket | None = None
    openigtlink: socket.socket | None = None
    token: str = ""
    read_open: bool = True


def listening(option: str, address: str, port: int | None) -> socket.socket:
    """A socket that listens at "HOST:PORT", "HOST" or "PORT"; raises InputError, for example for a port in use.

    option: the option's name, for error messages; port: port if `address` states none; None means any free port
    """
    host, wanted = _parts(option, address, port)
    try:
        return socket.create_server((host, wanted), backlog=BACKLOG)
    except OSError as error:
        found = (error.strerror or type(error).__name__).lower()
        raise InputError.at(f"{option} {address}".strip(), "a free address", found) from None


def usual(port: int) -> socket.socket:
    """A socket on loopback at this port, or at any free port if this one is in use."""
    try:
        return socket.create_server((LOOPBACK, port), backlog=BACKLOG)
    except OSError:
        return socket.create_server((LOOPBACK, 0), backlog=BACKLOG)


def is_loopback(listener: socket.socket) -> bool:
    """Whether a socket can only be reached from this machine."""
    return ipaddress.ip_address(listener.getsockname()[0]).is_loopback


def address_of(listener: socket.socket) -> str:
    """HOST:PORT of this listener; HOST is its address, or the machine's name if it listens on all addresses."""
    host, port = listener.getsockname()[:2]
    return f"{socket.gethostname() if ipaddress.ip_address(host).is_unspecified else host}:{port}"


def names_of(listener: socket.socket) -> list[str]:
    """Possible Host headers for this listener: HOST:PORT; if the port is 80, also HOST.

    HOST is an address or a name of this machine at which the listener can be reached.
    """
    host, port = listener.getsockname()[:2]
    names = _names(ipaddress.ip_address(host))
    return [f"{one}:{port}" for one in names] + (names if port == 80 else [])


def _names(address: ipaddress.IPv4Address | ipaddress.IPv6Address) -> list[str]:
    if address.is_loopback:
        return [str(address), "localhost"]
    if not address.is_unspecified:
        return [str(address)]
    name = socket.gethostname()
    try:
        addresses = {str(one[4][0]) for one in socket.getaddrinfo(name, None, socket.AF_INET)}
    except OSError:
        addresses = set()
    return sorted({LOOPBACK, "localhost", name, *addresses})


def _parts(option: str, address: str, port: int | None) -> tuple[str, int]:
    host, _, number = address.rpartition(":") if ":" in address else ("", "", address)
    if not number.isdigit():
        if host:
            raise InputError.at(option, "HOST:PORT, HOST or PORT", shown(address))
        host, number = number, str(port or 0)
    if int(number) > 65535:
        raise InputError.at(option, "a port up to 65535", number)
    return host.strip("[]") or LOOPBACK, int(number)
