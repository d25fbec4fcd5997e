"""A live source watched: is it blocked, frozen, gone, back again? It knows no threads and no clock of its own."""

from __future__ import annotations

from collections import deque

import numpy as np

from vision.sources.events import EventKind, SourceEvent

INTERVALS = 3.0
"""A slow camera is not blocked or frozen before so many of its usual frame intervals are over; chosen."""
KEPT = 31
"""Frame intervals of which the median is the usual one; chosen."""


class SourceWatchdog:
    """What is known of a source from when its reads came back.

    A fault is noticed as soon as `check` is called after its time: blocked_s without an answer, frozen_s with the same
    picture (None: pictures may repeat), either lengthened to three usual frame intervals; a failed read at once.

    State: when an answer last came and when a new picture did [s], the last intervals [s], the size, the fault that
    lasts (None: none does), whether the picture repeats.
    """

    def __init__(self, began_s: float, *, blocked_s: float, frozen_s: float | None) -> None:
        for name, value in (("blocked_s", blocked_s), ("frozen_s", frozen_s)):
            if value is not None and not value > 0:
                raise ValueError(f"{name}: expected more than 0, found {value}")
        self.fault: EventKind | None = None
        self.new_s = began_s
        self._blocked_s, self._frozen_s = blocked_s, frozen_s
        self._answer_s = began_s
        self._intervals: deque[float] = deque(maxlen=KEPT)
        self._size: tuple[int, int] | None = None
        self._repeats = False

    @property
    def interval_s(self) -> float:
        """The usual time from picture to picture [s], 0 before two came."""
        return float(np.median(self._intervals)) if self._intervals else 0.0

    def saw_new(self, now_s: float, size_px: tuple[int, int]) -> list[SourceEvent]:
        """A new picture came, (width, height)."""
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
        """The picture came that had come before."""
        self._answer_s, self._repeats = now_s, True

    def saw_failure(self, now_s: float, why: str) -> list[SourceEvent]:
        """A read or an opening failed."""
        self._answer_s = now_s
        return self._now(now_s, EventKind.DROPPED, why)

    def check(self, now_s: float) -> list[SourceEvent]:
        """What has to be told by now, though nothing came."""
        if self.fault is EventKind.DROPPED:
            return []
        usual_s = INTERVALS * self.interval_s
        if now_s - self._answer_s > max(self._blocked_s, usual_s):
            return self._now(now_s, EventKind.BLOCKED, f"no answer for {now_s - self._answer_s:.2f} s")
        if self._repeats and self._frozen_s is not None and now_s - self.new_s > max(self._frozen_s, usual_s):
            return self._now(now_s, EventKind.FROZEN, f"the same picture for {now_s - self.new_s:.2f} s")
        return []

    def _now(self, now_s: float, kind: EventKind, text: str) -> list[SourceEvent]:
        if self.fault is kind:
            return []
        self.fault = kind
        return [SourceEvent(now_s, kind, text)]
