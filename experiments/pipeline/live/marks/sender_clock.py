"""Conversion of a sender's clock to this machine's monotonic clock by arrival times."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from experiments.formats.marks.times import likely_unit
from vision import SourceSettings

CLEAR = 2.0
"""A time unit is guessed if the frame interval in this unit differs from the expected interval at most by this factor;
choice."""


class Moment(NamedTuple):
    """Times of a frame: when it was sent, by the sender's clock, and when it arrived, by this machine's clock [s]."""

    sent_s: float
    arrival_s: float


class OrderError(ValueError):
    """Error for a frame whose time is out of order."""


class SenderClock:
    """Conversion of a sender's times to this machine's monotonic clock: adds the offset of the clocks.

    Frames arrive late, never early. The offset is therefore the least difference between arrival time and sent time in
    the last settings.remembered_frames frames. The offset includes the least transmission delay, which is unknown:
    converted times are late by this delay.

    A frame is refused if its sent time does not increase. A frame is also refused if the increase exceeds that of this
    machine's clock by more than settings.hung_s. If all frames are refused for settings.blocked_s although their sent
    times increase regularly, the sender has a new clock, and the conversion starts again.

    restarts: number of new clocks
    """

    def __init__(self, settings: SourceSettings) -> None:
        self.restarts = 0
        self._settings = settings
        self._took_s: deque[float] = deque(maxlen=settings.remembered_frames)
        self._last: Moment | None = None
        self._other: tuple[Moment, Moment] | None = None

    def exposure_s(self, sent_s: float, arrival_s: float) -> float:
        """Exposure time of a frame by this machine's clock [s]. Raises OrderError if the frame is refused.

        sent_s: time of the frame by the sender's clock [s]; arrival_s: its arrival by this machine's clock [s]
        """
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
        """Reason why frame `now` cannot follow frame `last`; None if it can."""
        risen_s, passed_s = now.sent_s - last.sent_s, now.arrival_s - last.arrival_s
        if risen_s <= 0.0:
            return f"time_s: expected more than {last.sent_s:.6f}, found {now.sent_s:.6f}"
        if risen_s > passed_s + self._settings.hung_s:
            unit = likely_unit(risen_s, passed_s, CLEAR) if passed_s > 0.0 else None
            guess = "" if unit is None else f": it seems to be {unit}"
            return f"time_s: expected seconds, {passed_s:.3f} s after {last.sent_s:.6f}, found {now.sent_s:.6f}{guess}"
        return None
