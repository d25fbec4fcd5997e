"""Whether times of arrival tell when pictures were exposed: of a source that tells no times of its own. No clock."""

from __future__ import annotations

from collections import deque

import numpy as np

from vision.sources.settings import DEFAULTS, SourceSettings


class Arrivals:
    """How far exposure times by arrival may be wrong, from when the reads of a source came back.

    After a pause, a read that did not come back for `settings.blocked_s`, all further pictures may be as late:
    who queued them may have lost none. They may until pictures come far faster than usual and the queue is empty again,
    or a read fails, which it does not where a picture waits. Nothing else in the arrivals tells a source that lags from
    one that lost pictures.
    An interval that is no whole number of usual ones is of pictures that waited: those about it are of unknown time.

    State: when a picture last came [s], the last intervals [s]; late_s, by how much pictures may come later than is
    taken [s]; when one last came out of step [s].
    """

    def __init__(self, settings: SourceSettings = DEFAULTS) -> None:
        self.late_s = 0.0
        self._settings = settings
        self._last_s: float | None = None
        self._intervals: deque[float] = deque(maxlen=settings.settled_frames)
        self._uneven_s = -np.inf

    def came(self, now_s: float, *, told: bool = False) -> None:
        """A picture came, new or again; told: the source itself tells when it was exposed."""
        before_s, self._last_s = self._last_s, now_s
        if told:
            self.late_s, self._uneven_s = 0.0, -np.inf
        if before_s is None:
            return
        interval_s, s = now_s - before_s, self._settings
        usual_s = self._usual_s
        if usual_s is not None and self.late_s > 0.0 and interval_s < s.uneven_share * usual_s:
            self.late_s = max(self.late_s + interval_s - usual_s, 0.0)  # from a queue that empties
            self.late_s = 0.0 if self.late_s <= usual_s else self.late_s
            self._uneven_s = now_s
            return
        self._intervals.append(interval_s)
        if told or usual_s is None:
            return
        if interval_s > max(s.blocked_s, s.slow_intervals * usual_s):
            self.late_s += interval_s - usual_s
            return
        off_s = abs(interval_s - max(1, round(interval_s / max(usual_s, s.uneven_s))) * usual_s)
        if off_s > max(s.uneven_s, s.uneven_share * usual_s):
            self._uneven_s = now_s

    def failed(self) -> None:
        """A read failed: no picture waits."""
        self._last_s, self.late_s = None, 0.0

    def uneven(self, now_s: float) -> bool:
        """Whether pictures came out of step within the last `settings.even_s`."""
        return now_s - self._uneven_s < self._settings.even_s

    @property
    def _usual_s(self) -> float | None:
        """The usual interval [s]; None before half of those of which it is the median came."""
        known = len(self._intervals) >= self._settings.settled_frames // 2
        return float(np.median(self._intervals)) if known else None
