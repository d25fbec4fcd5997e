"""The simulated phantom and its camera in their own process, so that they take no time from the estimation loop."""

from __future__ import annotations

import multiprocessing
import struct
from multiprocessing.connection import Connection
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from experiments.threads import begin_helper, start_helper

PHANTOM, SCENARIO = "phantom", "webcam"
"""The simulated phantom: its name as a source of pictures, and the name of its scenario."""

HEADER = struct.Struct("<dII")
"""Header of a picture: exposure time on the monotonic clock [s], width [px], height [px]. Processes share the clock."""

ENDS_S = 2.0
"""Longest time to wait for the end of the process [s]; choice."""


def film(connection: Connection, fps: float | None) -> None:
    """Wait for a request, then send each of the phantom's pictures at its exposure time, until the connection ends."""
    begin_helper(connected=True)
    # imported here, so that the parent process does not wait for it
    from experiments.formats.scenario import read_scenario
    from experiments.simulation.phantom_camera import PhantomCamera

    scenario = read_scenario(SCENARIO)
    if fps is not None:
        scenario = scenario.model_copy(update={"frame_interval_s": 1.0 / fps})
    camera = PhantomCamera(scenario)
    camera.grab()  # loads code that the first picture needs
    try:
        connection.recv_bytes()
        while camera.grab():
            exposure_s = 1e-3 * camera.get(cv2.CAP_PROP_POS_MSEC)
            image = camera.retrieve()[1]
            connection.send_bytes(HEADER.pack(exposure_s, image.shape[1], image.shape[0]) + image.tobytes())
    except (OSError, EOFError):
        pass  # the reader is gone
    finally:
        connection.close()


class PhantomProcess:
    """Pictures of a `PhantomCamera` in another process, with the interface of cv2.VideoCapture.

    The constructor starts the process, which first loads code for some seconds. `opened` starts the phantom's motion.
    fps: frame rate that replaces the scenario's frame rate [frames/s]
    """

    def __init__(self, fps: float | None = None) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=film, args=(theirs, fps), name="softaim phantom", daemon=True)
        start_helper(self._process)
        theirs.close()
        self._sent = b""

    def opened(self) -> Self:
        """Wait for the first picture and return this object; OSError or EOFError if none comes."""
        self._connection.send_bytes(b"begin")
        self._sent = self._connection.recv_bytes()
        return self

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Always true."""
        return True

    def grab(self) -> bool:
        """Wait for the next picture; False if none will come."""
        try:
            self._sent = self._connection.recv_bytes()
        except (OSError, EOFError):
            return False
        return True

    def retrieve(self) -> tuple[bool, NDArray[np.uint8]]:
        """A writable copy of the last picture; the compiled kernels of `vision` need writable pictures."""
        _exposure_s, width, height = HEADER.unpack_from(self._sent)
        pixels = np.frombuffer(self._sent, dtype=np.uint8, offset=HEADER.size)
        return True, pixels.reshape(height, width, 3).copy()

    def get(self, prop: int) -> float:
        """For CAP_PROP_POS_MSEC, the exposure time of the last picture on the monotonic clock [ms]; otherwise 0."""
        return 1e3 * float(HEADER.unpack_from(self._sent)[0]) if prop == cv2.CAP_PROP_POS_MSEC else 0.0

    def release(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join(ENDS_S)
        self._connection.close()
