"""Faults of a live run's environment: viewers, terminal, disk, ports, and termination by the system."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import ClassVar

import numpy as np

from experiments.errors import InputError
from experiments.studies.faults.judge import FOREVER, LASTS_S, ONSET_S, Fault, Judged, Moment, verdict
from experiments.studies.faults.process import LiveRun, filmed
from experiments.studies.faults.viewer import Viewer

AFTER_S = 3.0
"""Time from the end of a fault to the end of the run [s]. If the fault never ends, this time begins at the onset."""
STARTS_S = 12.0
"""Time limit from the start of the film to the first displayed state [s]: four times the usual duration."""
JITTER_S = 1.0
"""Largest random delay of the fault's onset [s]. It equals the length of the pieces in which a recording is stored."""
STARTS_WITHIN_S = 10.0
"""Time limit for the error message of a run that cannot start [s]."""
N_VIEWERS = 50
SLOW_S = 1.0
"""Time for which a slow viewer shows a state [s]."""
N_WARNINGS, AT_ONCE = 1500, 20
"""Number of refused requests, and number of requests sent before the answers are read. For each request, the process
prints a line of about 70 characters. All lines together exceed a terminal's buffer."""
USUAL_PORT = 8765
"""Default port of a run's page."""
IN_VAIN = json.dumps({"command": "hue", "node": "a mark that the scene does not have", "place_px": [0, 0]})
"""A request that the process refuses. The advice continues; a refused pose of the needle would end the advice."""

Acts = Callable[[LiveRun], None]


@dataclass(frozen=True, slots=True)
class SystemFault(Fault):
    """A `Fault` that acts on a real process, which runs `softaim live` on a film.

    before: action before the process starts; begins, ends: actions at the onset and at the end of the fault
    writes: whether the process can still write files after the onset
    """

    before: Acts = lambda _run: None
    begins: Acts = lambda _run: None
    ends: Acts = lambda _run: None
    writes: bool = True
    alone: ClassVar[bool] = True

    def judged(self, seed: int, folder: Path, onset_s: float = ONSET_S) -> Judged:
        """Result of a run; onset_s: least time from first state to onset [s]. Raises InputError if no state appears."""
        if sys.platform == "win32":
            raise InputError.at(f"fault {self.name}", "a POSIX system", "Windows")
        onset_s += float(np.random.default_rng(seed).uniform(0.0, JITTER_S))
        lasts_s = 0.0 if np.isinf(self.lasts_s) else self.lasts_s
        film = filmed(seed, ceil(STARTS_S + onset_s + lasts_s + AFTER_S))
        with LiveRun(film, folder) as run:
            self.before(run)
            began_s = time.monotonic()
            if run.start():
                return self._watched(run, onset_s)
            how = run.ended()
            lines = run.terminal.text.strip().splitlines()
            said = Moment(ONSET_S + time.monotonic() - began_s, 0.0, "ENDED", None, "; ".join(lines), 0.0, False, False)
            return replace(verdict(self, [said], FOREVER), ended=how)

    def _watched(self, run: LiveRun, onset_s: float) -> Judged:
        viewer = run.viewer
        _until(run, -np.inf)
        _until(run, viewer.now_s + onset_s)
        onset_s = viewer.now_s
        if run.process.poll() is not None:
            raise InputError.at(f"fault {self.name}", f"a run that starts within {STARTS_S:g} s", "a slower one")
        self.begins(run)
        lasts_s = 0.0 if np.isinf(self.lasts_s) else self.lasts_s
        _until(run, onset_s + lasts_s)
        self.ends(run)
        _until(run, min(onset_s + lasts_s + AFTER_S, run.film.ends_s))
        until_s = run.stop()
        how = run.ended()
        found = verdict(self, _moments(viewer, onset_s, until_s), self.lasts_s)
        others = sum(one.faulty_go for each in run.others for one in _moments(each, onset_s, until_s))
        return replace(
            found,
            shown=found.shown.replace(f"{run.folder}{os.sep}", ""),
            go_shown_while_faulty=found.go_shown_while_faulty + others,
            ended=how,
            lacks_s=run.lacks_s(until_s if self.writes else onset_s),
        )


def _moments(viewer: Viewer, onset_s: float, until_s: float) -> list[Moment]:
    """What a viewer showed before the film was at until_s [s]. Times are shifted so that the onset is at ONSET_S."""
    return [replace(one, time_s=one.time_s - onset_s + ONSET_S) for one in viewer.moments if one.time_s < until_s]


def _until(run: LiveRun, time_s: float) -> None:
    """Wait until the film is at time_s [s]. If the process ended before it sent a state, do not wait."""
    while not run.viewer.now_s > time_s and (np.isfinite(run.viewer.now_s) or run.process.poll() is None):
        time.sleep(0.005)


def _with_openigtlink(run: LiveRun) -> None:
    with socket.create_server(("127.0.0.1", 0)) as one:  # a free port
        run.igtl_port = one.getsockname()[1]
    run.options += ["--openigtlink", f"127.0.0.1:{run.igtl_port}"]


def _slow(run: LiveRun) -> None:
    """Add a viewer that shows each state for a second. Also connect a client to each server; the clients never read."""
    run.others.append(run.watched(SLOW_S))
    port = run.address[0]
    for number in (port, run.igtl_port):
        one = run.held.enter_context(socket.socket())
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.connect(("127.0.0.1", number))
        if number == port:
            one.sendall(
                f"GET /stream?pictures=1 HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
                "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
                "Sec-WebSocket-Version: 13\r\n\r\n".encode("ascii")
            )


def _many(run: LiveRun) -> None:
    """Start a thread that connects fifty viewers. They stay connected until the fault ends."""
    from websockets.asyncio.client import connect
    from websockets.exceptions import ConnectionClosed

    address = f"ws://127.0.0.1:{run.address[0]}/stream"
    refused: list[str] = []

    async def one() -> None:
        try:
            async with asyncio.timeout(LASTS_S), connect(address, open_timeout=None) as stream:
                async for _message in stream:
                    pass
        except TimeoutError:
            return
        except ConnectionClosed as closed:
            refused.append("" if closed.rcvd is None else closed.rcvd.reason)
            if len(refused) == 1:
                run.viewer.tell(f"to further viewers: {refused[0]}")

    async def all_of_them() -> None:
        await asyncio.gather(*(one() for _ in range(N_VIEWERS)))

    thread = threading.Thread(target=lambda: asyncio.run(all_of_them()), name="viewers", daemon=True)
    thread.start()
    run.held.callback(thread.join, LASTS_S)


def _in_terminal(run: LiveRun) -> None:
    run.on_terminal = True


def _warned(run: LiveRun) -> None:
    """Send requests that the process refuses. For each request, the process prints a line to its output."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    port, token = run.address
    address = f"ws://127.0.0.1:{port}/stream?pace=1"
    known = [Subprotocol("softaim.v1"), Subprotocol(f"token.{token}")]
    with (
        contextlib.suppress(ConnectionClosed, OSError),  # also TimeoutError
        connect(address, subprotocols=known, close_timeout=0.1) as stream,
    ):
        for _ in range(N_WARNINGS // AT_ONCE):
            for _ in range(AT_ONCE):
                stream.send(IN_VAIN)
            for _ in range(AT_ONCE):
                stream.recv(timeout=1.0)


def _unread(run: LiveRun) -> None:
    run.terminal.read = False
    _warned(run)


def _read_again(run: LiveRun) -> None:
    run.terminal.read = True


def _closed(run: LiveRun) -> None:
    run.terminal.close()
    _warned(run)


def _full(run: LiveRun) -> None:
    """Limit the size of the process's files to zero, so that writing fails, as on a full disk."""
    import resource

    resource.prlimit(run.process.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))


def _taken(run: LiveRun) -> None:
    """Let another program occupy the requested port."""
    other = run.held.enter_context(socket.create_server(("127.0.0.1", 0)))
    run.options = ["--page", f"127.0.0.1:{other.getsockname()[1]}"]


def _usual_taken(run: LiveRun) -> None:
    """Let another program occupy the page's default port, and start the run without a requested port."""
    with contextlib.suppress(OSError):  # another program already occupies the port
        run.held.enter_context(socket.create_server(("127.0.0.1", USUAL_PORT)))
    run.options = []


def _killed(number: signal.Signals) -> Acts:
    return lambda run: os.kill(run.process.pid, number)


SYSTEM: tuple[SystemFault, ...] = (
    SystemFault("no fault of the system", "no fault, in real time", 0.0),
    SystemFault("slow consumer", "a viewer is slow, other clients never read", before=_with_openigtlink, begins=_slow),
    SystemFault("50 viewers", "fifty viewers connect at once", begins=_many),
    SystemFault(
        "terminal not read",
        "the terminal reads none of 1,500 lines for 4 s",
        2.0 * LASTS_S,
        before=_in_terminal,
        begins=_unread,
        ends=_read_again,
    ),
    SystemFault("stdout closed", "1,500 lines are written to closed outputs", FOREVER, begins=_closed),
    SystemFault("disk full", "the disk is full", FOREVER, begins=_full, writes=False),
    SystemFault("TERM", "SIGTERM ends the process", FOREVER, begins=_killed(signal.SIGTERM), writes=False),
    SystemFault("KILL", "SIGKILL ends the process", FOREVER, begins=_killed(signal.SIGKILL), writes=False),
    SystemFault("port taken", "another program uses the requested port", FOREVER, STARTS_WITHIN_S, before=_taken),
    SystemFault("usual port taken", "another program uses the page's default port", 0.0, before=_usual_taken),
)
