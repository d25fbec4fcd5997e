"""Filter for frames that arrive late. After a late frame, it repeats the updates with all later frames."""

from __future__ import annotations

from bisect import insort
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from estimators.arrays import Floats
from estimators.core.track import FilterSnapshot, TissueFilter
from estimators.tissue.estimate import MarkMeasurement, TargetEstimate
from estimators.tissue.snapshot import all_or_nothing


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """Measurement at an exposure time [s]: marks, or a fix of the target with position [m] and covariance [m²]."""

    time_s: float
    marks: tuple[MarkMeasurement, ...] = ()
    fix: tuple[Floats, Floats] | None = None


@dataclass(slots=True)
class _Kept:
    """An event, and the state of the filter before this event."""

    event: Event
    before: FilterSnapshot = field(repr=False)


class Replay:
    """Filter that accepts measurements (events) in any order, unless they are older than its history.

    For a late event, the filter returns to its state before the event's exposure time, then uses this event and all
    later ones. The result equals, bit for bit, the result of the same events in order of exposure.

    horizon_s: length of the history [s]
    State: the filter, the events of the last horizon_s, and the state of the filter before each event.
    late: number of late events by result: `fused` for used events, `rejected` for events older than the history
    """

    def __init__(self, tissue: TissueFilter, horizon_s: float = 0.5) -> None:
        if not horizon_s >= 0:
            raise ValueError(f"horizon_s: expected 0 s or more, found {horizon_s}")
        self.tissue = tissue
        self.horizon_s = horizon_s
        self.late: Counter[str] = Counter()
        self._kept: list[_Kept] = []

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> TargetEstimate | None:
        """Use the marks of an exposure time [s]. Returns the newest estimate; None if the time precedes the history.

        Raises the errors of `TissueFilter.predict` and `TissueFilter.update`.
        """
        return self._fused(Event(time_s, marks=tuple(marks)))

    def fix(self, time_s: float, position: Floats, cov: Floats) -> TargetEstimate | None:
        """Use a fix measured at a time [s]. Returns the newest estimate; None if the time precedes the history.

        position: measured position of the target [m], (dim,); cov: covariance of this position [m²], (dim, dim)
        """
        return self._fused(Event(time_s, fix=(position, cov)))

    def snapshot(self) -> tuple[FilterSnapshot, Sequence[_Kept]]:
        """The filter's state and the history of events, for `restore`."""
        return self.tissue.snapshot(), tuple(self._kept)

    def restore(self, then: tuple[FilterSnapshot, Sequence[_Kept]]) -> None:
        """Reset the filter and the history to a snapshot."""
        self.tissue.restore(then[0])
        self._kept = list(then[1])

    @all_or_nothing
    def _fused(self, event: Event) -> TargetEstimate | None:
        newest = self.tissue.time_s
        late = newest is not None and event.time_s < newest
        later = [kept for kept in self._kept if kept.event.time_s > event.time_s]
        began = later[0].before.time_s if later else None  # None: there is no later event
        unkept = not later or (began is not None and began > event.time_s)
        if newest is not None and late and (unkept or event.time_s < newest - self.horizon_s):
            self.late["rejected"] += 1
            return None
        estimate = self._again_with(event, later) if late else self._apply(event)
        if late:
            self.late["fused"] += 1
        newest = self.tissue.time_s or event.time_s
        self._kept = [kept for kept in self._kept if kept.event.time_s >= newest - self.horizon_s]
        return estimate

    def _again_with(self, event: Event, later: Sequence[_Kept]) -> TargetEstimate:
        self.tissue.restore(later[0].before)
        self._kept = [kept for kept in self._kept if kept.event.time_s <= event.time_s]
        estimate = self._apply(event)
        for old in later:
            estimate = self._apply(old.event)
        return estimate

    def _apply(self, event: Event) -> TargetEstimate:
        before = self.tissue.snapshot()
        self.tissue.predict(event.time_s)
        estimate = self.tissue.fix(*event.fix) if event.fix is not None else self.tissue.update(event.marks)
        insort(self._kept, _Kept(event, before), key=lambda kept: kept.event.time_s)
        return estimate
