"""Detection of a source's faults: missing, repeated and lost pictures.

The caller states all times: this module uses no threads and no clock.
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
"""Mean grey level, 0 to 255, below which a picture is dark; choice. In the dark, cameras may send fewer pictures."""


class SourceWatchdog:
    """Detects faults of a live source from the arrival times of its pictures.

    The time limit is settings.blocked_s or settings.slow_intervals frame intervals, whichever is longer. `check`
    reports a fault if no read has returned for longer than the time limit, or if the reads have returned only one
    picture for longer than the time limit. A failed read is also a fault.

    may_repeat: whether a picture may repeat without a fault, as in a film
    fault: the present fault; None: no fault; new_s: time of the last new picture [s]
    """

    def __init__(self, began_s: float, settings: SourceSettings = DEFAULTS, *, may_repeat: bool = False) -> None:
        self.fault: EventKind | None = None
        self._settings, self._may_repeat = settings, may_repeat
        self.begin(began_s)
        self._intervals: deque[float] = deque(maxlen=settings.settled_frames)
        self._size: tuple[int, int] | None = None
        self._repeats = False

    def begin(self, now_s: float) -> None:
        """Set the time from which pictures are expected [s]."""
        self.new_s = self._answer_s = now_s

    @property
    def interval_s(self) -> float:
        """Median interval between the arrivals of pictures [s]; 0 before the second picture."""
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
        """Record a picture that equals an earlier picture."""
        self._answer_s, self._repeats = now_s, True

    def saw_failure(self, now_s: float, why: str) -> list[SourceEvent]:
        """Record a failed read or opening."""
        self._answer_s = now_s
        return self._now(now_s, EventKind.DROPPED, why)

    def check(self, now_s: float) -> list[SourceEvent]:
        """Test whether the source is blocked or frozen at the time now_s [s]. Returns the new events."""
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
"""Number of recent frames with which a new frame is compared. A hung driver may repeat several old frames in turn."""


class FrozenValues:
    """Detects a source that repeats old frames.

    A frame is a repeat if its values equal those of one of the last `IN_TURN` frames. New values contain noise, and
    therefore almost never repeat. But some senders send each frame several times. Let n be the median number of repeats
    of earlier frames. The source is frozen if the present frame has n + settings.stuck_frames - 1 repeats or more.
    A frame without values is ignored.

    frozen: whether the source is frozen now
    """

    def __init__(self, settings: SourceSettings = DEFAULTS) -> None:
        self.frozen = False
        self._most = settings.stuck_frames - 1
        self._recent: deque[dict[str, tuple[float, ...]]] = deque(maxlen=IN_TURN)
        self._repeats: deque[int] = deque([0], maxlen=settings.settled_frames)
        self._n_repeats, self._new_s = 0, 0.0

    def saw(self, time_s: float, values: Mapping[str, tuple[float, ...]]) -> tuple[bool, list[SourceEvent]]:
        """Test a frame that consists of named values. Returns whether the frame is a repeat, and the new events."""
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

    Let n be `settings.stuck_frames`. A gap is an interval of more than 1.5 median intervals. The loss is reported if at
    least two of the last n intervals are gaps, and if the last n intervals together are at least 2 n median intervals.
    The loss ends after `settings.even_s` without a gap. If an interval is shorter than half the median interval,
    pictures have waited for a late reader. After such an interval, only later intervals are tested.
    """

    def __init__(self, settings: SourceSettings = DEFAULTS) -> None:
        self._settings = settings
        self._last_s: float | None = None
        self._in_step_s = -np.inf
        self._intervals: deque[float] = deque(maxlen=settings.settled_frames)
        self._of_late: deque[float] = deque(maxlen=settings.stuck_frames)
        self._gap_s: float | None = None

    def began_again(self) -> None:
        """Record a pause of the source. The interval between the last picture and the next one is not tested."""
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
        """Median interval between exposures [s]; None until there are settled_frames / 2 intervals."""
        known = len(self._intervals) >= self._settings.settled_frames // 2
        return median_low(self._intervals) if known else None
