"""The camera before the simulated phantom in a process of its own: it takes no time of the loop."""

from __future__ import annotations

import multiprocessing
import struct
from multiprocessing.connection import Connection

import cv2
import numpy as np

from experiments.formats.scenario import Scenario
from experiments.simulation.phantom_camera import PhantomCamera
from experiments.threads import begin_helper
from vision.arrays import Image

TIME = struct.Struct("<d")
"""Before the pixels of a picture: its exposure time on the monotonic clock [s], which all processes share."""

ENDS_S = 2.0
"""How long that process has to end [s]; chosen."""


def film(connection: Connection, scenario: Scenario) -> None:
    """Send the phantom's pictures as they are due, until nobody takes them."""
    begin_helper()
    camera = PhantomCamera(scenario)
    try:
        while camera.grab():
            exposure_s = 1e-3 * camera.get(cv2.CAP_PROP_POS_MSEC)
            connection.send_bytes(TIME.pack(exposure_s) + camera.retrieve()[1].tobytes())
    except OSError:
        pass  # nobody does any more
    finally:
        connection.close()


class PhantomProcess:
    """Pictures of a `PhantomCamera` that runs elsewhere, as cv2.VideoCapture gives them; opened when the first came.

    OSError or EOFError where none does. State: the process, and what it sent last.
    """

    def __init__(self, scenario: Scenario, size_px: tuple[int, int]) -> None:
        context = multiprocessing.get_context("spawn")
        self._shape = (size_px[1], size_px[0], 3)
        self._connection, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=film, args=(theirs, scenario), name="softaim phantom", daemon=True)
        self._process.start()
        theirs.close()
        self._sent = self._connection.recv_bytes()

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

    def retrieve(self) -> tuple[bool, Image]:
        """The picture that came last, a copy: what is compiled for pictures is for such as can be written."""
        return True, np.frombuffer(self._sent, dtype=np.uint8, offset=TIME.size).reshape(self._shape).copy()

    def get(self, prop: int) -> float:
        """CAP_PROP_POS_MSEC: when the picture that came last was taken, on the clock [ms]; 0 for all else."""
        return 1e3 * float(TIME.unpack_from(self._sent)[0]) if prop == cv2.CAP_PROP_POS_MSEC else 0.0

    def release(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.join(ENDS_S)
        self._connection.close()
