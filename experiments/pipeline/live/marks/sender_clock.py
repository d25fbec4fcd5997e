"""The clock of a sender, tied to the monotonic one by when its frames arrive."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from experiments.formats.marks.times import likely_unit
from vision import SourceSettings

CLEAR = 2.0
"""By this factor a frame's time may be off in another unit for that to be named [1]; chosen."""


class Moment(NamedTuple):
    """When a frame was seen by the sender's clock, and when it arrived by the own one [s]."""

    sent_s: float
    arrival_s: float


class OrderError(ValueError):
    """A frame whose time cannot follow the one before."""


class SenderClock:
    """Times of a sender's frames on the own monotonic clock: its times, and the least that a frame ever took to arrive.

    A frame arrives late and never early: of the last settings.remembered_frames frames the one that took the least ties
    the clocks, which also follows a clock that drifts. What that one took is not known, and counts as none: all times
    are late by it.

    A time that does not rise, or rises by over settings.hung_s more than passed here, is refused. Where for
    settings.blocked_s only such frames come, and they follow each other, the sender has another clock, as after a
    restart: then they are what counts.

    State: what the last frames took, by both clocks [s]; the last frame; the first and the last of those of another
    clock; restarts, how often one was adopted.
    """

    def __init__(self, settings: SourceSettings) -> None:
        self.restarts = 0
        self._settings = settings
        self._took_s: deque[float] = deque(maxlen=settings.remembered_frames)
        self._last: Moment | None = None
        self._other: tuple[Moment, Moment] | None = None

    def exposure_s(self, sent_s: float, arrival_s: float) -> float:
        """When a frame of this time was exposed, by the own clock [s]; raises OrderError."""
        now = Moment(sent_s, arrival_s)
        if self._last is not None and (why := self._refusal(self._last, now)) is not None:
            first = now if self._other is None or self._refusal(self._other[1], now) is not None else self._other[0]
            self._other = (first, now)
            if arrival_s - first.arrival_s < self._settings.blocked_s:
                raise OrderError(why)
            self._took_s.clear()
            self.restarts += 1
        self._last, self._other = now, None
        self._took_s.append(arrival_s - sent_s)
        return sent_s + min(self._took_s)

    def _refusal(self, last: Moment, now: Moment) -> str | None:
        """Why a frame cannot come after the last; None where it can."""
        risen_s, passed_s = now.sent_s - last.sent_s, now.arrival_s - last.arrival_s
        if risen_s <= 0.0:
            return f"time_s: expected more than {last.sent_s:.6f}, found {now.sent_s:.6f}"
        if risen_s > passed_s + self._settings.hung_s:
            unit = likely_unit(risen_s, passed_s, CLEAR) if passed_s > 0.0 else None
            guess = "" if unit is None else f": it seems to be {unit}"
            return f"time_s: expected seconds, {passed_s:.3f} s after {last.sent_s:.6f}, found {now.sent_s:.6f}{guess}"
        return None
