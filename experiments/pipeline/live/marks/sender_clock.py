"""Clock of a sender, tied to the monotonic one by arrival times."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from experiments.formats.marks.times import likely_unit
from vision import SourceSettings

CLEAR = 2.0
"""Largest ratio of a frame's time in another unit to the expected time for which the unit is named [1]; choice."""


class Moment(NamedTuple):
    """Times of a frame: by the sender's clock, and of arrival by the own clock [s]."""

    sent_s: float
    arrival_s: float


class OrderError(ValueError):
    """Error for a frame whose time is out of order."""


class SenderClock:
    """Conversion of a sender's times to the own monotonic clock: its times plus the least delay of a frame.

    A frame arrives late but never early: the frame with the least delay of the last settings.remembered_frames ties the
    clocks, which also follows a drifting clock. That least delay is unknown and assumed to be zero: all times are late
    by it.

    A time that does not increase, or increases by over settings.hung_s more than the own clock, is refused. If only
    such frames come for settings.blocked_s, and in order, the sender has another clock, for example after a restart,
    which is then adopted.

    State: delays of the last frames, by both clocks [s]; the last frame; the first and the last frame of another clock;
    restarts, the number of adopted ones.
    """

    def __init__(self, settings: SourceSettings) -> None:
        self.restarts = 0
        self._settings = settings
        self._took_s: deque[float] = deque(maxlen=settings.remembered_frames)
        self._last: Moment | None = None
        self._other: tuple[Moment, Moment] | None = None

    def exposure_s(self, sent_s: float, arrival_s: float) -> float:
        """Exposure time by the own clock [s] of a frame with this time; raises OrderError."""
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
        """Reason why a frame cannot follow the last; None if it can."""
        risen_s, passed_s = now.sent_s - last.sent_s, now.arrival_s - last.arrival_s
        if risen_s <= 0.0:
            return f"time_s: expected more than {last.sent_s:.6f}, found {now.sent_s:.6f}"
        if risen_s > passed_s + self._settings.hung_s:
            unit = likely_unit(risen_s, passed_s, CLEAR) if passed_s > 0.0 else None
            guess = "" if unit is None else f": it seems to be {unit}"
            return f"time_s: expected seconds, {passed_s:.3f} s after {last.sent_s:.6f}, found {now.sent_s:.6f}{guess}"
        return None
