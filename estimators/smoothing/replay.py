"""Filter for frames that arrive late or out of order: it updates again with all later frames of its history."""

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
    """Measurement at one exposure time [s]: marks, or a fix of the target (position [m] and covariance [m²])."""

    time_s: float
    marks: tuple[MarkMeasurement, ...] = ()
    fix: tuple[Floats, Floats] | None = None


@dataclass(slots=True)
class _Kept:
    """An event and the state of the filter before it."""

    event: Event
    before: FilterSnapshot = field(repr=False)


class Replay:
    """Filter that accepts frames in any order, if they are not older than its history.

    Each event is used at its own exposure time: the filter returns to the state just before it and repeats the later
    events. The result equals, bit for bit, the result of the events in order.

    horizon_s: length of the history [s]
    State: the filter; the events of the last horizon_s, and the filter's state before each of them.
    late: numbers of events that arrived late; `fused` events were used, `rejected` events were older than the history
    """

    def __init__(self, tissue: TissueFilter, horizon_s: float = 0.5) -> None:
        if not horizon_s >= 0:
            raise ValueError(f"horizon_s: expected 0 s or more, found {horizon_s}")
        self.tissue = tissue
        self.horizon_s = horizon_s
        self.late: Counter[str] = Counter()
        self._kept: list[_Kept] = []

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> TargetEstimate | None:
        """The newest estimate after marks exposed at this time [s]; None if they are older than the history.

        Raises ValueError as the filter does.
        """
        return self._fused(Event(time_s, marks=tuple(marks)))

    def fix(self, time_s: float, position: Floats, cov: Floats) -> TargetEstimate | None:
        """The newest estimate after a fix of the target at this time [s]; None if it is older than the history.

        position: measured position [m], (dim,); cov: its covariance [m²], (dim, dim)
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
