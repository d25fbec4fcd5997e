"""Exposure times: of devices on the one monotonic clock, of films by their own times.

A rule is made anew for each opening of a source and asked once for each frame, in order.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

TRUSTED_AFTER = 30
"""Frames in a row whose own times must prove sane before they are used; chosen."""
MOST_OFF_S = 0.05
"""How far a device's times may wander beside the clock's within the frames remembered; chosen."""
REMEMBERED = 300
"""Frames over which the earliest arrival ties the device's clock to ours: 10 s at 30 frames/s; chosen."""
ROUNDING_S = 1.1e-3
"""Containers round their times to a millisecond: index / rate is the finer one where the two agree so far."""


ExposureRule = Callable[[Any, float], float]
"""Exposure time [s] of the frame that grab() of a capture gave at a time [s]."""


def stated_exposure_time(capture: Any, _grabbed_s: float) -> float:
    """Exposure time [s] of a capture that knows it: CAP_PROP_POS_MSEC on the monotonic clock."""
    return float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3


class DeviceTimes:
    """Exposure times of a device's frames: half a frame interval, the usual one, before the frame was complete.

    A frame is complete when grab() gives it; or when the device says, by CAP_PROP_POS_MSEC, if that has proved sane
    over 30 frames in a row: increasing, and beside the time of grab() by the same to 0.05 s. The device's clock is tied
    to ours by the earliest arrival in 300 frames, for a frame can come late and never early; a clock that drifts is
    followed so. Once it has proved sane, up to 30 frames in a row may come later than that, as from a device's queue
    after a pause; a clock that goes back, stands or runs ahead is used no more until it proves sane again. Half an
    interval stands for exposure and read-out, which no device tells.

    State: the device's times and the clock's of the last frames; how many sane ones, how many late ones came in a row.
    """

    def __init__(self) -> None:
        self._grabbed: deque[float] = deque(maxlen=TRUSTED_AFTER + 1)
        self._offsets: deque[float] = deque(maxlen=REMEMBERED)
        self._told_s = -np.inf
        self._sane = self._late = 0

    @property
    def trusts_device(self) -> bool:
        """Whether the device's own times are used."""
        return self._sane >= TRUSTED_AFTER

    def __call__(self, capture: Any, grabbed_s: float) -> float:
        """Exposure time [s] of the frame that grab() gave at grabbed_s [s]."""
        self._grabbed.append(grabbed_s)
        told_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3
        self._judge(told_s, grabbed_s)
        complete_s = told_s + min(self._offsets) if self.trusts_device else grabbed_s
        return complete_s - 0.5 * self._interval_s(capture)

    def _judge(self, told_s: float, grabbed_s: float) -> None:
        increasing = bool(np.isfinite(told_s)) and told_s > self._told_s
        self._told_s = told_s if np.isfinite(told_s) else -np.inf
        offset_s = grabbed_s - told_s
        lowest_s, highest_s = min(self._offsets, default=offset_s), max(self._offsets, default=offset_s)
        if increasing and self.trusts_device and offset_s > lowest_s + MOST_OFF_S and self._late < TRUSTED_AFTER:
            self._late += 1
            return
        self._late = 0
        if increasing and max(highest_s, offset_s) - min(lowest_s, offset_s) <= MOST_OFF_S:
            self._sane += 1
        else:
            self._sane = 0
            self._offsets.clear()
        if np.isfinite(told_s):
            self._offsets.append(offset_s)

    def _interval_s(self, capture: Any) -> float:
        if len(self._grabbed) > 1:
            return float(np.median(np.diff(self._grabbed)))
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        return 1.0 / rate if 1.0 <= rate <= 1000.0 else 0.0


class FilmTimes:
    """Exposure times of a film's frames [s], the first at 0: index / rate, or the container's where the two part.

    They part where the frame rate varies, or is not the one that the film's head says. A container whose times are not
    finite and increasing is not asked again: then index / rate. Raises ValueError where neither can be had: no rate, or
    container times that fail after they had parted.

    State: frames so far, the container's first and last time [s], whether they ever parted, whether they failed.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate if np.isfinite(rate) and rate > 0 else None
        self._index = 0
        self._first_s = 0.0
        self._last_s = -np.inf
        self._parted = self._rate is None
        self._failed = False

    def __call__(self, container_s: float) -> float:
        """Exposure time [s] of the next frame, whose time in the container is container_s [s]."""
        index, self._index = self._index, self._index + 1
        if index == 0 and np.isfinite(container_s):
            self._first_s = container_s
        time_s = container_s - self._first_s
        self._failed = self._failed or not (np.isfinite(time_s) and time_s > self._last_s)
        by_rate = None if self._rate is None else index / self._rate
        if self._failed:
            if by_rate is None:
                raise ValueError(f"frame {index}: expected a frame rate or increasing times in the film, found neither")
            if self._parted:
                raise ValueError(f"frame {index}: expected a time after {self._last_s:g} s, found {time_s:g} s")
            return by_rate
        self._last_s = time_s
        if by_rate is not None and abs(time_s - by_rate) <= ROUNDING_S:
            return by_rate
        self._parted = True
        return time_s
