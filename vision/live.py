"""Frames as they come: a camera read in its own thread, of which only the newest frame counts."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, Protocol, Self

import cv2
import numpy as np

from vision.sources import Frame, SourceError, quiet_opencv


class Capture(Protocol):
    """What a source of frames must do, as cv2.VideoCapture does; if it has isOpened() or release(), they are used."""

    def read(self) -> tuple[bool, Any]:
        """Wait for the next frame; False at the end."""


class LiveFrames:
    """The newest frame not yet seen, again and again, until the source ends or `close()`.

    open_capture: opens the source; called in the reading thread, which a dead device may hold for ever
    paced: hold each frame of a film back until it is due by the film's frame rate
    timeout_s: a source that delivers nothing for so long raises SourceError
    clock, sleep: the one monotonic clock [s] by which frames get their exposure time, and how to wait by it

    State, shared with the thread: the newest frame, how many came, how the thread ended.
    `frames_dropped` counts frames that a newer one replaced unseen.
    """

    def __init__(
        self,
        open_capture: Callable[[], Any],
        *,
        paced: bool = False,
        timeout_s: float = 2.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not timeout_s > 0:
            raise ValueError(f"timeout_s: expected more than 0, found {timeout_s}")
        self._open, self._paced, self._timeout_s = open_capture, paced, timeout_s
        self._clock, self._sleep = clock, sleep
        self._changed = threading.Condition()
        self._newest: Frame | None = None
        self._ended = False
        self._closed = False
        self._error: Exception | None = None
        self.frames_dropped = 0
        # A daemon: a device may block in read() for ever (OpenCV #4468), and the program must end all the same.
        self._thread = threading.Thread(target=self._run, name="softaim frames", daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self._wait()) is not None:
            yield frame

    def _wait(self) -> Frame | None:
        with self._changed:
            came = self._changed.wait_for(
                lambda: self._newest is not None or self._ended or self._closed, timeout=self._timeout_s
            )
            if self._closed:
                return None
            frame, self._newest = self._newest, None
            if frame is not None:
                return frame
            if self._error is not None:
                raise self._error
            if not came:
                raise SourceError(f"live frames: expected a frame within {self._timeout_s:g} s, found none")
            return None

    def _run(self) -> None:
        try:
            with quiet_opencv():
                capture = self._open()
            try:
                self._read(capture)
            finally:
                _release(capture)
        except Exception as error:
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _read(self, capture: Capture) -> None:
        is_opened = getattr(capture, "isOpened", None)
        if is_opened is not None and not is_opened():
            raise SourceError("live frames: expected a camera or film that opens, found none")
        interval_s = _interval(capture) if self._paced else 0.0
        began, index = self._clock(), 0
        while not self._closed:
            if interval_s:
                late = self._clock() - began - index * interval_s
                if late < 0:
                    self._sleep(-late)
            read, image = capture.read()
            exposure = self._clock()
            if not read or image is None:
                return
            self._offer(Frame(index, exposure, np.asarray(image)))
            index += 1

    def _offer(self, frame: Frame) -> None:
        with self._changed:
            if self._newest is not None:
                self.frames_dropped += 1
            self._newest = frame
            self._changed.notify_all()

    def close(self) -> None:
        """Stop; the reading thread lets go of the device as soon as it comes back from it."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=0.5)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _interval(capture: Any) -> float:
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    if not (np.isfinite(rate) and rate > 0):
        raise SourceError(f"live frames: expected a film with a frame rate, found {rate:g} frames/s")
    return 1.0 / rate


def _release(capture: Any) -> None:
    release = getattr(capture, "release", None)
    if release is not None:
        release()
