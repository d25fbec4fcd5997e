"""Playback of a film at the speed of its exposure times, with the interface of a camera."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import cv2

from vision.arrays import Image
from vision.sources.every_frame import FrameFile
from vision.sources.frames import Frame


@dataclass(slots=True)
class Start:
    """Common start of films. at_s: clock time at which time 0 of the films is played [s]; None: not yet started."""

    at_s: float | None = None


class Playback:
    """Capture that plays a file. Each frame is due at its exposure time, counted from the start of the playback.

    start: start of the playback. Films that play together get the same `Start`.
    """

    def __init__(
        self,
        frames: FrameFile,
        start: Start | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._frames, self._coming = frames, iter(frames)
        self._clock, self._sleep = clock, sleep
        self._shown: Frame | None = None
        self._start = Start() if start is None else start

    @property
    def origin_s(self) -> float:
        """Clock time at which time 0 of the film is played [s]; the present before the first frame."""
        return self._clock() if self._start.at_s is None else self._start.at_s

    def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
        """Always True."""
        return True

    def grab(self) -> bool:
        """Wait until the next frame is due; returns False after the last frame."""
        self._shown = next(self._coming, None)
        if self._shown is None:
            return False
        if self._start.at_s is None:
            self._start.at_s = self._clock() - self._shown.exposure_s
        wait_s = self._start.at_s + self._shown.exposure_s - self._clock()
        if wait_s > 0:
            self._sleep(wait_s)
        return True

    def retrieve(self) -> tuple[bool, Image | None]:
        """Whether `grab` has reached a frame, and the pixels of this frame, (height, width, 3) BGR."""
        return self._shown is not None, None if self._shown is None else self._shown.image

    def get(self, prop: int) -> float:
        """Clock time at which the present frame is due [ms] if prop is CAP_PROP_POS_MSEC; otherwise 0."""
        if prop != cv2.CAP_PROP_POS_MSEC or self._shown is None:
            return 0.0
        return 1e3 * (self.origin_s + self._shown.exposure_s)

    def release(self) -> None:
        """Close the file."""
        self._frames.close()
