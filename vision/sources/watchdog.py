"""Detection of a source's faults: blocked, frozen, failed or resumed; lost pictures; repeated values.

This module uses no threads and no clock.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from statistics import median_low

import numpy as np

from vision.arrays import Image
from vision.sources.events import EventKind, SourceEvent
from vision.sources.settings import DEFAULTS, SourceSettings

DARK = 60
"""Mean grey level of a picture below which cameras may use longer exposures, out of 255; choice."""


class SourceWatchdog:
    """Detects faults of a live source from the arrival times of its pictures.

    A failed read is a fault. `check` also reports a fault if no read returned for too long, or if reads returned only
    the same picture for too long. Too long is more than settings.blocked_s and more than settings.slow_intervals frame
    intervals.

    may_repeat: whether pictures may repeat, like those of a film

    State: times of the last returned read and of the last new picture [s]; the last intervals [s]; the picture's size;
    the present fault or None; whether the picture repeats.
    """

    def __init__(self, began_s: float, settings: SourceSettings = DEFAULTS, *, may_repeat: bool = False) -> None:
        self.fault: EventKind | None = None
        self._settings, self._may_repeat = settings, may_repeat
        self.begin(began_s)
        self._intervals: deque[float] = deque(maxlen=settings.settled_frames)
        self._size: tuple[int, int] | None = None
        self._repeats = False

    def begin(self, now_s: float) -> None:
        """Expect pictures from a time on [s]."""
        self.new_s = self._answer_s = now_s

    @property
    def interval_s(self) -> float:
        """Median interval between the last pictures [s]; 0 before the second picture."""
        return float(np.median(self._intervals)) if self._intervals else 0.0

    def saw_new(self, now_s: float, size_px: tuple[int, int]) -> list[SourceEvent]:
        """Record a new picture, with its width and height [px]."""
        events = []
        if self.fault is not None:
            events.append(SourceEvent(now_s, EventKind.RESUMED, f"after {now_s - self.new_s:.2f} s without a frame"))
        elif self._size is not None:
            self._intervals.append(now_s - self.new_s)
        if self._size not in (None, size_px):
            was, now = (f"{size[0]} x {size[1]}" for size in (self._size, size_px) if size is not None)
            events.append(SourceEvent(now_s, EventKind.RESIZED, f"from {was} to {now} px"))
        self.fault, self._size, self._repeats = None, size_px, False
        self.new_s = self._answer_s = now_s
        return events

    def saw_repeat(self, now_s: float) -> None:
        """Record a picture that equals an earlier one."""
        self._answer_s, self._repeats = now_s, True

    def saw_failure(self, now_s: float, why: str) -> list[SourceEvent]:
        """Record a failed read or opening."""
        self._answer_s = now_s
        return self._now(now_s, EventKind.DROPPED, why)

    def check(self, now_s: float) -> list[SourceEvent]:
        """The events at a time [s], if the source has been blocked or frozen for too long."""
        if self.fault is EventKind.DROPPED:
            return []
        most_s = max(self._settings.blocked_s, self._settings.slow_intervals * self.interval_s)
        if now_s - self._answer_s > most_s:
            return self._now(now_s, EventKind.BLOCKED, f"no answer for {now_s - self._answer_s:.2f} s")
        if self._repeats and not self._may_repeat and now_s - self.new_s > most_s:
            return self._now(now_s, EventKind.FROZEN, f"the same picture for {now_s - self.new_s:.2f} s")
        return []

    def _now(self, now_s: float, kind: EventKind, text: str) -> list[SourceEvent]:
        if self.fault is kind:
            return []
        self.fault = kind
        return [SourceEvent(now_s, kind, text)]


IN_TURN = 8
"""Number of last frames from which a new frame must differ: a hung driver may deliver its buffers in turn."""


class FrozenValues:
    """Detects frames that repeat one of the last `IN_TURN` frames: their values are equal to the last digit.

    Because of noise, new values almost never repeat. Some senders send each frame several times. The source is
    therefore frozen only if the number of repeats in a row, plus one, exceeds the median number of repeats by at least
    settings.stuck_frames. A frame without values is ignored.

    frozen: whether the source is frozen now
    State: frozen; the last new frames; number of repeats of each frame; time of the newest frame [s].
    """

    def __init__(self, settings: SourceSettings = DEFAULTS) -> None:
        self.frozen = False
        self._most = settings.stuck_frames - 1
        self._recent: deque[dict[str, tuple[float, ...]]] = deque(maxlen=IN_TURN)
        self._repeats: deque[int] = deque([0], maxlen=settings.settled_frames)
        self._n_repeats, self._new_s = 0, 0.0

    def saw(self, time_s: float, values: Mapping[str, tuple[float, ...]]) -> tuple[bool, list[SourceEvent]]:
        """Whether the values of a frame, by name, repeat and must not be used; the events to report."""
        if not values:
            return False, []
        if any(values.items() <= one.items() for one in self._recent):
            self._n_repeats += 1
            if self.frozen or self._n_repeats < self._most + median_low(self._repeats):
                return True, []
            self.frozen = True
            text = f"{self._n_repeats} times the same values, to the last digit, in {time_s - self._new_s:.2f} s"
            return True, [SourceEvent(time_s, EventKind.FROZEN, f"{text}: they are not used")]
        events = []
        if self.frozen:
            text = f"new values after {time_s - self._new_s:.2f} s"
            events.append(SourceEvent(time_s, EventKind.RESUMED, text))
        if self._recent:
            self._repeats.append(self._n_repeats)
        self._recent.append(dict(values))
        self.frozen, self._n_repeats, self._new_s = False, 0, time_s
        return False, events


class SparsePictures:
    """Detects from exposure times that at least half of the pictures are lost.

    The usual interval is the median of the last intervals. A gap is an interval of more than 1.5 usual intervals.
    Pictures are sparse if the last n = `settings.stuck_frames` intervals together last at least 2 n usual intervals,
    and at least two of them are gaps. An interval below half the usual interval shows that the reader was late, so that
    pictures had to wait. The fault is reported once, and ends after `settings.even_s` without a gap.

    State: exposure times of the last picture and of the last picture that had not waited [s]; the last intervals [s];
    the intervals since pictures last waited [s]; time of the last gap [s], None if pictures are not sparse.
    """

    def __init__(self, settings: SourceSettings = DEFAULTS) -> None:
        self._settings = settings
        self._last_s: float | None = None
        self._in_step_s = -np.inf
        self._intervals: deque[float] = deque(maxlen=settings.settled_frames)
        self._of_late: deque[float] = deque(maxlen=settings.stuck_frames)
        self._gap_s: float | None = None

    def began_again(self) -> None:
        """After a pause, ignore the interval between the last picture and the next one."""
        self._last_s = None

    def saw(self, exposure_s: float, image: Image) -> list[SourceEvent]:
        """Record a picture and its exposure time [s]; returns the events."""
        before_s, self._last_s = self._last_s, exposure_s
        if before_s is None or not exposure_s > before_s:
            return []
        interval_s, usual_s = exposure_s - before_s, self._usual_s
        if usual_s is not None and interval_s < 0.5 * usual_s:
            self._of_late.clear()
            if exposure_s - self._in_step_s < self._settings.even_s:
                return []
        else:
            self._in_step_s = exposure_s
        self._intervals.append(interval_s)
        if usual_s is None:
            return []
        self._of_late.append(interval_s)
        if interval_s > 1.5 * usual_s and self._gap_s is not None:
            self._gap_s = exposure_s
        return self._judged(exposure_s, usual_s, image)

    def _judged(self, now_s: float, usual_s: float, image: Image) -> list[SourceEvent]:
        n, late, s = len(self._of_late), self._of_late, self._settings
        if self._gap_s is not None:
            if now_s - self._gap_s < s.even_s:
                return []
            self._gap_s = None
            return [SourceEvent(now_s, EventKind.RESUMED, f"every picture comes, {1.0 / usual_s:.0f} a second")]
        due, gaps = round(sum(late) / usual_s), sum(one > 1.5 * usual_s for one in late)
        if n < s.stuck_frames or due < 2 * n or gaps < 2:
            return []
        self._gap_s = now_s
        why = "the rest is lost on cable or machine; take load off"
        if image.mean() < DARK:
            why = f"the camera is slower in the dark, or {why}, and give it light"
        return [SourceEvent(now_s, EventKind.SPARSE, f"{n} pictures came in the time of {due}: {why}")]

    @property
    def _usual_s(self) -> float | None:
        """Median of the last intervals [s]; None until there are settled_frames / 2 intervals."""
        known = len(self._intervals) >= self._settings.settled_frames // 2
        return median_low(self._intervals) if known else None
