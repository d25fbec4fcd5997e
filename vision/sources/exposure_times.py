"""Exposure times of frames: on the monotonic clock for devices, and relative to the first frame for films.

The arrival time of a frame is the monotonic time at which grab() returned. A rule is a function that computes the
exposure time of each frame, in order. A reopened source gets a new rule.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from statistics import median_low
from typing import Any

import cv2
import numpy as np

from vision.sources.settings import DEFAULTS, SourceSettings

ROUNDING_S = 1.1e-3
"""Largest rounding error of a time in a film's container [s]."""


ExposureRule = Callable[[Any, float], float]
"""Function from a capture and a frame's arrival time [s] to the frame's exposure time [s]."""


def stated_exposure_time(capture: Any, _grabbed_s: float) -> float:
    """Exposure time on the monotonic clock [s], from the capture's property CAP_PROP_POS_MSEC."""
    return float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3


class DeviceTimes:
    """Rule for the exposure times of a device.

    The device time is CAP_PROP_POS_MSEC. The delay is the arrival time minus the device time. Device times are
    plausible if they increase, and if the delays vary by at most clock_error_s. At first, a frame is assumed to be
    complete at its arrival time. After settled_frames plausible device times in a row, a frame is assumed to be
    complete at its device time plus the least delay of the last remembered_frames frames. Up to settled_frames late
    frames in a row, for example from a queue after a pause, are not used for the least delay. The exposure time is
    assumed to be half the median frame interval before the frame is complete, because devices do not report it.

    late_s: increase of the delay [s] if the increase exceeds settings.blocked_s; otherwise 0. The delay increases if
        frames wait in a queue, or if the device's clock was set back.
    """

    def __init__(self, settings: SourceSettings = DEFAULTS) -> None:
        self._settings = settings
        self._grabbed: deque[float] = deque(maxlen=settings.settled_frames + 1)
        self._offsets: deque[float] = deque(maxlen=settings.remembered_frames)
        self._device_s = -np.inf
        self._plausible = self._late = 0
        self._before_s = np.nan
        self.late_s = 0.0

    @property
    def trusts_device(self) -> bool:
        """Whether the device's own times are used."""
        return self._plausible >= self._settings.settled_frames

    def __call__(self, capture: Any, grabbed_s: float) -> float:
        """Exposure time of the frame with the arrival time grabbed_s [s]."""
        self._grabbed.append(grabbed_s)
        device_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3
        self._judge(device_s, grabbed_s)
        complete_s = device_s + min(self._offsets) if self.trusts_device else grabbed_s
        return complete_s - 0.5 * self._interval_s(capture)

    def _judge(self, device_s: float, grabbed_s: float) -> None:
        most_s, n_settled = self._settings.clock_error_s, self._settings.settled_frames
        increasing = bool(np.isfinite(device_s)) and device_s > self._device_s
        self._device_s = device_s if np.isfinite(device_s) else -np.inf
        offset_s = grabbed_s - device_s
        lowest_s, highest_s = min(self._offsets, default=offset_s), max(self._offsets, default=offset_s)
        if increasing and self.trusts_device and offset_s > lowest_s + most_s and self._late < n_settled:
            self._late += 1
            return
        if increasing and self.trusts_device and offset_s > lowest_s + self._settings.blocked_s:
            self._before_s, self.late_s = lowest_s, offset_s - lowest_s
        elif self.late_s > 0.0 and abs(offset_s - self._before_s) <= most_s:
            self.late_s = 0.0
        self._late = 0
        if increasing and max(highest_s, offset_s) - min(lowest_s, offset_s) <= most_s:
            self._plausible += 1
        else:
            self._plausible = 0
            self._offsets.clear()
        if np.isfinite(device_s):
            self._offsets.append(offset_s)

    def _interval_s(self, capture: Any) -> float:
        if len(self._grabbed) > 1:
            return float(np.median(np.diff(self._grabbed)))
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        return 1.0 / rate if 1.0 <= rate <= 1000.0 else 0.0


class RisingTimes:
    """Rule that uses the exposure times of the given rule while they increase.

    If they do not increase for settings.stuck_frames frames in a row, arrival times minus a constant delay are used
    from then on. This delay was measured at the last frame whose exposure time increased.
    """

    def __init__(self, rule: ExposureRule, settings: SourceSettings = DEFAULTS) -> None:
        self._rule, self._settings = rule, settings
        self._last_s, self._delay_s, self._stuck = -np.inf, 0.0, 0
        self._by_arrival = False
        self._fault: str | None = None

    def __call__(self, capture: Any, grabbed_s: float) -> float:
        """Exposure time of the frame with the arrival time grabbed_s [s]. Two successive results may be equal."""
        device = self._rule if isinstance(self._rule, DeviceTimes) else None
        trusted = device is not None and device.trusts_device
        stated_s = self._rule(capture, grabbed_s)
        if device is not None and trusted and not device.trusts_device:
            self._fault = "the device's clock stands, goes back or wanders: times of arrival are used"
        if self._by_arrival:
            return grabbed_s - self._delay_s
        if np.isfinite(stated_s) and stated_s > self._last_s:
            self._last_s, self._delay_s, self._stuck = stated_s, grabbed_s - stated_s, 0
            return stated_s
        self._stuck += 1
        if self._stuck < self._settings.stuck_frames:
            return self._last_s
        self._by_arrival = True
        self._fault = f"exposure times have not risen in {self._stuck} frames: times of arrival are used"
        return grabbed_s - self._delay_s

    @property
    def by_source(self) -> bool:
        """Whether exposure times are computed from times that the source reports, not from arrival times."""
        by_device = not isinstance(self._rule, DeviceTimes) or self._rule.trusts_device
        return by_device and not self._by_arrival

    @property
    def late_s(self) -> float:
        """Value of `DeviceTimes.late_s` [s]; 0 if the given rule is not `DeviceTimes`."""
        return self._rule.late_s if isinstance(self._rule, DeviceTimes) else 0.0

    def take_fault(self) -> str | None:
        """Text of the last fault of the exposure times; None if there was no fault since the last call."""
        fault, self._fault = self._fault, None
        return fault


class FilmTimes:
    """Exposure times of a film's frames [s]. The time of the first frame is 0.

    The container states a time for each frame. If this time differs from index / rate by at most `ROUNDING_S`, the
    exposure time is index / rate. Otherwise, the exposure time is the container's time. A container's time is invalid
    if it is not finite or does not increase. From the first invalid time on, the exposure time is index / rate. But if
    there is no rate, or if a container's time was used before, an invalid time raises ValueError.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate if np.isfinite(rate) and rate > 0 else None
        self._index = 0
        self._first_s = 0.0
        self._last_s = -np.inf
        self._parted = self._rate is None
        self._failed = False

    def __call__(self, container_s: float) -> float:
        """Exposure time of the next frame [s]. container_s: time that the film's container states for it [s]."""
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


class Arrivals:
    """Test whether the arrival times of pictures determine their exposure times.

    A pause exceeds settings.blocked_s and settings.slow_intervals median intervals. After a pause, pictures may be late
    by up to the length of the pause: a queue may have formed. Short intervals reduce this delay. After a failed
    read, the delay is 0. If the source reports exposure times, pauses cause no delay. An arrival is uneven if the
    interval before it is not a multiple of the median interval: this picture waited for an unknown time.

    late_s: largest possible delay of pictures due to a pause [s]
    """

    def __init__(self, settings: SourceSettings = DEFAULTS) -> None:
        self.late_s = 0.0
        self._settings = settings
        self._last_s: float | None = None
        self._intervals: deque[float] = deque(maxlen=settings.settled_frames)
        self._uneven_s = -np.inf

    def came(self, now_s: float, *, by_source: bool = False) -> None:
        """Record the arrival of a new or repeated picture. by_source: whether the source reports exposure times."""
        before_s, self._last_s = self._last_s, now_s
        if by_source:
            self._uneven_s = -np.inf
        if before_s is None:
            return
        interval_s, s = now_s - before_s, self._settings
        usual_s = self._usual_s
        if usual_s is not None and self.late_s > 0.0 and interval_s < s.uneven_share * usual_s:
            self.late_s = max(self.late_s + interval_s - usual_s, 0.0)  # the queue is emptying
            self.late_s = 0.0 if self.late_s <= usual_s else self.late_s
            self._uneven_s = now_s
            return
        self._intervals.append(interval_s)
        if by_source or usual_s is None:
            return
        if interval_s > max(s.blocked_s, s.slow_intervals * usual_s):
            self.late_s += interval_s - usual_s
            return
        off_s = abs(interval_s - max(1, round(interval_s / max(usual_s, s.uneven_s))) * usual_s)
        if off_s > max(s.uneven_s, s.uneven_share * usual_s):
            self._uneven_s = now_s

    def failed(self) -> None:
        """Record a failed read. If a read fails, no picture waits in a queue."""
        self._last_s, self.late_s = None, 0.0

    def uneven(self, now_s: float) -> bool:
        """Whether an arrival was uneven within the last `settings.even_s`."""
        return now_s - self._uneven_s < self._settings.even_s

    @property
    def _usual_s(self) -> float | None:
        """Median interval between arrivals [s]; None until there are settled_frames / 2 intervals."""
        known = len(self._intervals) >= self._settings.settled_frames // 2
        return median_low(self._intervals) if known else None
