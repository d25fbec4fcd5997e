"""Playback of recorded marks at the pace of their times."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from experiments.arrays import Floats
from experiments.formats.marks.rows import MarkRow, without_repeats
from experiments.pipeline.live.marks.receiver import MarksFrame
from experiments.pipeline.track import measurement
from vision import Closing, EventKind, SourceEvent


class MarksReplay(Closing):
    """Playback of marks.csv: delivers the newest frame that is due. The playback starts at the first call of `next`.

    A frame that repeats earlier values is delivered without marks.
    """

    def __init__(
        self,
        exposures_s: Floats,
        marks: Sequence[Sequence[MarkRow]],
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.frames_dropped = 0
        self._first_s = float(exposures_s[0])
        self._times_s = (exposures_s - exposures_s[0]).tolist()
        self._marks, events = without_repeats(exposures_s - exposures_s[0], marks)
        self._due = deque(events)
        self._clock, self._sleep = clock, sleep
        self._next = 0
        self._began_s: float | None = None
        self._events: list[SourceEvent] = []
        self.ended = False

    @property
    def origin_s(self) -> float:
        """Clock time at which the time in marks.csv is zero [s]; 0 before the first frame."""
        return 0.0 if self._began_s is None else self._began_s - self._first_s

    def next(self, timeout_s: float) -> MarksFrame | None:
        """The newest frame that is due and not yet delivered; None at the end, or if none is due in timeout_s [s]."""
        now = self._clock()
        if self._began_s is None:
            self._began_s = now
        if self.ended:
            return None
        if self._next == len(self._times_s):
            self._events.append(SourceEvent(now, EventKind.ENDED, "after the last frame"))
            self.ended = True
            return None
        wait_s = self._began_s + self._times_s[self._next] - now
        if wait_s > timeout_s:
            self._sleep(timeout_s)
            return None
        if wait_s > 0.0:
            self._sleep(wait_s)
        now = max(self._clock(), now + wait_s)
        k = self._next
        while k + 1 < len(self._times_s) and self._began_s + self._times_s[k + 1] <= now:
            k += 1
        self.frames_dropped += k - self._next
        self._next = k + 1
        while self._due and self._due[0].time_s <= self._times_s[k]:
            event = self._due.popleft()
            self._events.append(replace(event, time_s=self._began_s + event.time_s))
        marks = tuple(measurement(mark) for mark in self._marks[k])
        return MarksFrame(k, self._began_s + self._times_s[k], marks)

    def take_events(self) -> tuple[SourceEvent, ...]:
        """The events since the last call, in order."""
        events, self._events = tuple(self._events), []
        return events

    def close(self) -> None:
        """End the source."""
        self.ended = True
