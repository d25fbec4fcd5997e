"""Exposure times of devices, on the monotonic clock, and of films, by their own times; tests of arrival times.

A rule belongs to one opening of a source and is called once for each frame, in order.
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
"""Largest rounding error of times in containers [s]: index / rate is used if it is that close to all of these times."""


ExposureRule = Callable[[Any, float], float]
"""Function that returns the exposure time [s] of the frame that a capture's grab() returned at a given time [s]."""


def stated_exposure_time(capture: Any, _grabbed_s: float) -> float:
    """Exposure time [s] that the capture itself states: CAP_PROP_POS_MSEC on the monotonic clock."""
    return float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3


class DeviceTimes:
    """Rule for the exposure times of a device: half a usual frame interval before the frame was complete.

    A frame is complete when grab() returns or, after settled_frames plausible times in a row, at the device's own time,
    CAP_PROP_POS_MSEC. Plausible times increase, and their offset to grab()'s times varies by at most clock_error_s.
    The device's clock is tied to the monotonic one by the earliest arrival in remembered_frames, because a frame can
    come late but never early; this follows a drifting clock. A trusted device may deliver up to settled_frames in a row
    too late, for example from its queue after a pause. A clock that goes back, stands still or runs ahead is not used
    until it is plausible again. Half an interval is assumed for exposure and read-out, which devices do not report.

    late_s: largest delay of frames beyond the assumed delay [s]: frames that are late for longer than
    settings.blocked_s come from a queue, or the clock was set back; 0 when frames come as early as before
    State: late_s; the device's and the clock's times of the last frames; numbers of plausible and of late frames in a
    row; the clock's earlier delay [s].
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
        """Exposure time [s] of the frame that grab() returned at grabbed_s [s]."""
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
    """Rule for exposure times that uses another rule while its times increase, otherwise arrival times.

    After settings.stuck_frames frames in a row with times that stand still, go back or are not numbers, arrival times
    are used, minus the delay of the last frame whose time increased.

    State: time and delay of the last frame whose time increased [s]; number of frames since; whether arrival times are
    used; the fault not yet fetched.
    """

    def __init__(self, rule: ExposureRule, settings: SourceSettings = DEFAULTS) -> None:
        self._rule, self._settings = rule, settings
        self._last_s, self._delay_s, self._stuck = -np.inf, 0.0, 0
        self._by_arrival = False
        self._fault: str | None = None

    def __call__(self, capture: Any, grabbed_s: float) -> float:
        """Exposure time [s] of the frame that grab() returned at grabbed_s [s]; the last one if times stand still."""
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
        """Whether the times are the source's own and not arrival times."""
        by_device = not isinstance(self._rule, DeviceTimes) or self._rule.trusts_device
        return by_device and not self._by_arrival

    @property
    def late_s(self) -> float:
        """Largest delay of frames, by the source's own times [s]."""
        return self._rule.late_s if isinstance(self._rule, DeviceTimes) else 0.0

    def take_fault(self) -> str | None:
        """The fault of the times since the last call; None if there was none."""
        fault, self._fault = self._fault, None
        return fault


class FilmTimes:
    """Exposure times of a film's frames [s], the first at 0: index / rate, or the container's times if the two differ.

    They differ if the frame rate varies, or differs from that in the film's header. If container times are not finite
    and increasing, index / rate is used from then on. Raises ValueError if that is not possible: without a rate, or if
    the two have differed before.

    State: number of frames, the container's first and last time [s], whether they ever differed, whether they failed.
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


class Arrivals:
    """Test, from the times at which reads returned, whether arrival times determine exposure times.

    After a pause (a read did not return for `settings.blocked_s`) all further pictures may be late, from a queue that
    lost none. This ends when pictures come far faster than usual and the queue is empty again, or when a read fails,
    since it cannot fail while a picture waits. Arrival times do not otherwise distinguish a lagging source from one
    that lost pictures. The source's own times do so, if known before: lost pictures leave gaps in these times. An
    interval that is not a multiple of the usual one shows that pictures waited: their exposure times are unknown.

    State: arrival of the last picture [s], the last intervals [s]; late_s, the largest delay of pictures beyond the
    assumed delay [s]; time of the last irregular arrival [s].
    """

    def __init__(self, settings: SourceSettings = DEFAULTS) -> None:
        self.late_s = 0.0
        self._settings = settings
        self._last_s: float | None = None
        self._intervals: deque[float] = deque(maxlen=settings.settled_frames)
        self._uneven_s = -np.inf

    def came(self, now_s: float, *, by_source: bool = False) -> None:
        """Record the arrival of a picture, new or repeated; by_source: the source itself reports its exposure time."""
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
        """Record a failed read, which shows that no picture waits."""
        self._last_s, self.late_s = None, 0.0

    def uneven(self, now_s: float) -> bool:
        """Whether pictures came irregularly within the last `settings.even_s`."""
        return now_s - self._uneven_s < self._settings.even_s

    @property
    def _usual_s(self) -> float | None:
        """The usual interval [s], the median of recent intervals; None until half of these are known."""
        known = len(self._intervals) >= self._settings.settled_frames // 2
        return median_low(self._intervals) if known else None
