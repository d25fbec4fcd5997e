"""The camera before the simulated phantom in a process of its own: it takes no time of the loop."""

from __future__ import annotations

import multiprocessing
import struct
from multiprocessing.connection import Connection
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from experiments.threads import begin_helper

PHANTOM, SCENARIO = "phantom", "webcam"
"""What the simulated phantom is called as a source, and its scenario."""

HEADER = struct.Struct("<dII")
"""Before the pixels of a picture: its exposure time on the monotonic clock [s], which all processes share; its width
and height [px]."""

ENDS_S = 2.0
"""How long that process has to end [s]; chosen."""


def film(connection: Connection, fps: float | None) -> None:
    """Once it is asked to, send the phantom's pictures as they are due, until nobody takes them."""
    begin_helper()
    # here: the process that begins this one is not to wait for what it loads
    from experiments.formats.scenario import read_scenario
    from experiments.simulation.phantom_camera import PhantomCamera

    scenario = read_scenario(SCENARIO)
    if fps is not None:
        scenario = scenario.model_copy(update={"frame_interval_s": 1.0 / fps})
    camera = PhantomCamera(scenario)
    camera.grab()  # loads what the first picture would wait for
    try:
        connection.recv_bytes()
        while camera.grab():
            exposure_s = 1e-3 * camera.get(cv2.CAP_PROP_POS_MSEC)
            image = camera.retrieve()[1]
            connection.send_bytes(HEADER.pack(exposure_s, image.shape[1], image.shape[0]) + image.tobytes())
    except (OSError, EOFError):
        pass  # nobody does any more
    finally:
        connection.close()


class PhantomProcess:
    """Pictures of a `PhantomCamera` that runs elsewhere, as cv2.VideoCapture gives them.

    It begins at once, and loads for seconds: meanwhile others may, too. The phantom stands still until it is opened.
    fps: frames a second in place of the scenario's. State: the process, and what it sent last.
    """

    def __init__(self, fps: float | None = None) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=film, args=(theirs, fps), name="softaim phantom", daemon=True)
        self._process.start()
        theirs.close()
        self._sent = b""

    def opened(self) -> Self:
        """The same, once the first picture came; OSError or EOFError where none does."""
        self._connection.send_bytes(b"begin")
        self._sent = self._connection.recv_bytes()
        return self

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """It always is."""
        return True

    def grab(self) -> bool:
        """Wait for the next picture; False where none will come."""
        try:
            self._sent = self._connection.recv_bytes()
        except (OSError, EOFError):
            return False
        return True

    def retrieve(self) -> tuple[bool, NDArray[np.uint8]]:
        """The picture that came last, a copy: what is compiled for pictures is for such as can be written."""
        _exposure_s, width, height = HEADER.unpack_from(self._sent)
        pixels = np.frombuffer(self._sent, dtype=np.uint8, offset=HEADER.size)
        return True, pixels.reshape(height, width, 3).copy()

    def get(self, prop: int) -> float:
        """CAP_PROP_POS_MSEC: when the picture that came last was taken, on the clock [ms]; 0 for all else."""
        return 1e3 * float(HEADER.unpack_from(self._sent)[0]) if prop == cv2.CAP_PROP_POS_MSEC else 0.0

    def release(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.join(ENDS_S)
        self._connection.close()
