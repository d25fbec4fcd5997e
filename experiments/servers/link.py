"""The loop's side of the servers: it sends the newest state to the serving process, and receives requests.

The loop does not wait: one thread sends the newest state as soon as the serving process has received the previous one,
and another thread receives requests. If the process ends or hangs, the loop continues.
"""

from __future__ import annotations

import json
import multiprocessing
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from experiments.log import LOG, SHOWN
from experiments.plain import plain
from experiments.servers.faces import Faces
from experiments.servers.process import serve
from experiments.threads import start_helper

MOST_REQUESTS = 64
"""Largest number of waiting requests; further ones are refused; choice."""

PICTURE_S = 1.0 / 30.0
"""Least interval between pictures [s]; choice: a shorter interval would look the same."""

QUALITY = 80
"""JPEG quality, out of 100; choice: marks and their rims are clearly visible."""

ENDS_S = 2.0
"""Timeout for the end of the serving process [s]; choice."""


class Link:
    """A process that serves a live run, from its start to `close()`.

    notices: lines with the servers' addresses, which `tell` prints on standard error
    n_watching: number of clients that request pictures
    """

    def __init__(self, faces: Faces, notices: Sequence[str] = ()) -> None:
        self._notices = tuple(notices)
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, faces), name="softaim servers", daemon=True)
        start_helper(self._process)
        theirs.close()
        self._changed = threading.Condition()
        self._scene: Mapping[str, Any] | None = None
        self._waiting: tuple[Callable[[], Mapping[str, Any]], NDArray[np.uint8] | None] | None = None
        self._ready = False
        self._ended = False
        self._pictured_s = -float("inf")
        self.n_watching = 0
        self._requests: deque[Mapping[str, Any]] = deque()
        self._n_refused = 0
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._send, self._receive)]
        for thread in self._threads:
            thread.start()

    @property
    def wants_picture(self) -> bool:
        """Whether any client requests pictures and the next picture is due."""
        return self.n_watching > 0 and time.monotonic() - self._pictured_s >= PICTURE_S

    def begin(self, scene: Mapping[str, Any]) -> None:
        """Send the scene message, which comes before all states; from then on clients are served."""
        with self._changed:
            self._scene = scene
            self._changed.notify_all()

    def tell(self) -> None:
        """Print the servers' addresses once; later calls print nothing."""
        for line in self._notices:
            SHOWN.say(line)
        self._notices = ()

    def publish(self, message: Callable[[], Mapping[str, Any]], image: NDArray[np.uint8] | None) -> None:
        """Replace the state that waits to be sent; message: function that another thread calls to make the message."""
        with self._changed:
            self._waiting = message, image
            self._changed.notify_all()
        if image is not None:
            self._pictured_s = time.monotonic()

    def requests(self) -> Iterator[Mapping[str, Any]]:
        """The requests of clients, in order; a request that the caller does not take waits for the next call."""
        while self._requests:
            with self._changed:
                request = self._requests.popleft()
            yield request

    def close(self) -> None:
        """End the serving process."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        self._process.join(ENDS_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        for thread in self._threads:  # the process has closed its end of the connection
            thread.join(ENDS_S)
        self._connection.close()

    def _send(self) -> None:
        try:
            with self._changed:
                self._changed.wait_for(lambda: self._ended or self._scene is not None)
                scene = self._scene
            if scene is not None:
                self._connection.send_bytes(text_of(scene))
            while not self._ended:
                with self._changed:
                    self._changed.wait_for(lambda: self._ended or (self._ready and self._waiting is not None))
                    if self._ended or self._waiting is None:
                        break
                    (message, image), self._waiting, self._ready = self._waiting, None, False
                self._connection.send_bytes(text_of(message()))
                self._connection.send_bytes(b"" if image is None else jpeg(image))
            self._connection.send_bytes(b"")  # signals the end of states
        except (OSError, ValueError) as error:
            self._broken(error)

    def _receive(self) -> None:
        try:
            while True:
                found = json.loads(self._connection.recv_bytes())
                with self._changed:
                    if "ready" in found:
                        self._ready, self.n_watching = True, found["watching"]
                        self._changed.notify_all()
                    elif "fault" in found:
                        LOG.warning("%s", found["fault"])
                    else:
                        self._add(found)
        except (OSError, EOFError, ValueError) as error:
            self._broken(error)

    def _add(self, request: Mapping[str, Any]) -> None:
        """Add a request to the queue, unless `MOST_REQUESTS` wait.

        A needle's position replaces a position that is the last request in the queue.
        """
        if self._requests and request["command"] == self._requests[-1]["command"] == "needle":
            self._requests[-1] = request
        elif len(self._requests) < MOST_REQUESTS:
            self._requests.append(request)
        else:
            self._n_refused += 1
            if not self._n_refused & (self._n_refused - 1):  # only the 1st, 2nd, 4th, 8th and so on
                LOG.warning("not done: %d requests, because %d others waited", self._n_refused, MOST_REQUESTS)

    def _broken(self, error: Exception) -> None:
        with self._changed:
            ended, self._ended = self._ended, True
            self._changed.notify_all()
        if not ended:
            LOG.warning(
                "the process of page and network ended (%s); the run continues without them", type(error).__name__
            )


def text_of(message: Mapping[str, Any]) -> bytes:
    """A message as JSON; numbers that are not finite are null."""
    try:
        return json.dumps(message, allow_nan=False, separators=(",", ":")).encode()
    except ValueError:
        return json.dumps(plain(message), allow_nan=False, separators=(",", ":")).encode()


def jpeg(image: NDArray[np.uint8]) -> bytes:
    """A picture, (height, width, 3) BGR, as JPEG."""
    encoded: bytes = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    return encoded
