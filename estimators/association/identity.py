"""Which of the marks that look alike is which: names as hypotheses, a filter for each while they are in doubt."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from estimators.arrays import Floats
from estimators.association.exchanges import InterchangeableMarks, Names, renamed, seen_from
from estimators.association.settings import IdentitySettings
from estimators.filters.unscented import CovarianceError
from estimators.tissue.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.tissue.filter import Snapshot, TissueFilter
from estimators.tissue.health import Health, diverged


@dataclass(frozen=True, slots=True)
class IdentitySwap:
    """Marks that had been taken for each other, and are no longer.

    time_s, since_s: when it was undone, and since when it had been so [s]; nodes: whose marks they are
    """

    time_s: float
    since_s: float
    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class AssociatedEstimate:
    """What came of a frame: the estimate, the marks by the names that they bear now, a swap if one was undone."""

    estimate: TargetEstimate
    marks: tuple[MarkMeasurement, ...]
    swap: IdentitySwap | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Other names for the marks, and what the filter would know had it believed them.

    ahead: log of how much more probable than the names that are believed, negative as long as they are less
    since_s: since when the names differ [s]
    """

    names: Names
    ahead: float
    since_s: float
    knows: Snapshot
    estimate: TargetEstimate


Readings = dict[Names, Hypothesis]


class AssociationFilter:
    """Takes marks in, and goes over to other names for those that look alike once these explain clearly more.

    A hidden Markov model of the names. In each frame an exchange of two names that the frame alone does not rule out
    makes a rival: the filter as it was before, given the marks by those names, and followed from then on. Of two ways
    to the same names the more probable is kept (Viterbi's algorithm). The probability of a rival is the product of the
    likelihoods of its marks, frame by frame, with the odds against each exchange. It is dropped when it is clearly the
    worse; when it is clearly the better, and TRACKING, the filter goes on as if it had been adopted from the start.

    Where there is no estimate yet, any names may be right: at a start, after a divergence, and when innovations are
    too large for some time. Then the filter restarts by each of those that lie best about the rest shape; for the
    tissue may be turned or displaced, that counts for no more than `decisive`. One by the present names restarts
    beside them, which they must beat as well: or else a filter of large covariance, which nothing refutes, would win by
    that and not by its names.

    tissue: the filter; predict it, and then come here with the marks
    alike: groups of nodes whose marks look alike; names are never exchanged between groups
    State: called, the node of each mark that another gave a name to, if it is another one; rivals, and same_names, the
    one beside them; swaps undone; when names may next be tried from a start, and the pause after that.
    """

    def __init__(
        self, tissue: TissueFilter, alike: Iterable[Collection[str]], settings: IdentitySettings | None = None
    ) -> None:
        self.tissue = tissue
        self.settings = IdentitySettings() if settings is None else settings
        self.namesakes = InterchangeableMarks(tissue, alike)
        self.called: dict[str, str] = {}
        self.rivals: list[Hypothesis] = []
        self.swaps: list[IdentitySwap] = []
        self.same_names: Hypothesis | None = None
        self._next_s, self._pause_s = -np.inf, self._shortest_pause_s

    def named(self, marks: Sequence[MarkMeasurement]) -> tuple[MarkMeasurement, ...]:
        """Marks that another tracker named, by the nodes that they are believed to be on."""
        return renamed(marks, self.called)

    def fix(self, position: Floats, cov: Floats) -> TargetEstimate:
        """Take in a sighting of the target, as `TissueFilter.fix` does; it says nothing of the names."""
        tissue = self.tissue
        estimate = tissue.fix(position, cov)
        now = tissue.snapshot()
        same = [] if self.same_names is None else [self.same_names]
        fixed = [self._at(one, estimate.time_s, lambda: tissue.fix(position, cov)) for one in (*self.rivals, *same)]
        tissue.restore(now)
        self.same_names = fixed[-1] if same else None
        self.rivals = [one for one in fixed[: len(self.rivals)] if one is not None]
        return estimate

    def update(self, marks: Sequence[MarkMeasurement]) -> AssociatedEstimate:
        """Take in marks by the nodes that they are believed to be on, at the filter's time.

        Raises ValueError and CovarianceError as the filter does.
        """
        tissue, sakes = self.tissue, self.namesakes
        before = tissue.snapshot()
        anew = tissue.health.since_s is None or tissue.health.status is Status.LOST
        others = {} if anew else self._others(sakes.own, sakes.costs(tissue, marks), self.settings.decisive)
        estimate = tissue.update(marks)
        if anew:
            self.rivals, self.same_names = [], None
        try_all = anew or self._uneasy(estimate)
        if not others and not self.rivals and not try_all:
            return AssociatedEstimate(estimate, tuple(marks))
        believed = Hypothesis(sakes.own, 0.0, estimate.time_s, tissue.snapshot(), estimate)
        told = tissue.log_likelihood
        readings = {sakes.own: believed}
        start = replace(believed, ahead=-told, knows=before)
        for names, n_changes in others.items():
            _keep(readings, self._read(self._changed(start, names, n_changes), marks))
        for rival in self.rivals:
            self._follow(readings, replace(rival, ahead=rival.ahead - told), estimate.time_s, marks)
        if self.same_names is not None:
            same = self._at(self.same_names, estimate.time_s)
            self.same_names = same and self._read(replace(same, ahead=same.ahead - told), marks)
        best = _best(readings)
        if try_all and not (best.ahead > self.settings.decisive and best.estimate.status is not Status.DIVERGED):
            nothing = replace(start, ahead=best.ahead, knows=replace(before, health=Health()))
            self._start_anew(readings, nothing, marks, beside=not anew)
        return self._decided(readings, marks)

    @property
    def _shortest_pause_s(self) -> float:
        """Until innovations have been tested that are not those of the last time [s], and as long again."""
        return 2.0 * self.tissue.settings.test_s

    def _others(self, names: Names, costs: Floats, worst: float) -> Mapping[Names, int]:
        return self.namesakes.others(names, costs, worst, self.settings.max_hypotheses)

    def _changed(self, rival: Hypothesis, names: Names, n_changes: int) -> Hypothesis:
        """Other names by the state of a rival, after so many exchanges of two."""
        return replace(rival, names=names, ahead=rival.ahead - n_changes * self.settings.exchange)

    def _uneasy(self, estimate: TargetEstimate) -> bool:
        """Whether the innovations are such that any names may be right, and it is time to try them."""
        tested, now_s = self.tissue.health.innovations, estimate.time_s
        refuted = estimate.status is Status.DIVERGED and not tested
        if now_s < self._next_s or not (
            refuted or (estimate.marks_used and diverged(tested, 0.5 * self.tissue.settings.test_sigmas))
        ):
            return False
        if now_s - self._next_s > self._pause_s:
            self._pause_s = self._shortest_pause_s
        self._next_s = now_s + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, self.settings.longest_s)
        return True

    def _start_anew(
        self, readings: Readings, nothing: Hypothesis, marks: Sequence[MarkMeasurement], *, beside: bool
    ) -> None:
        """Start the filter anew by other names, as far ahead as the best is now, and by the same beside them."""
        costs = self.namesakes.costs(self.tissue, marks, anew=True)
        own = self.namesakes.own
        others, most = self._others(own, costs, np.inf), self.settings.decisive
        for names, n_changes in others.items():
            better = float(costs.trace() - costs[list(names), own].sum())
            start = replace(nothing, ahead=nothing.ahead + float(np.clip(better, -most, most)))
            _keep(readings, self._read(self._changed(start, names, n_changes), marks))
        if others and beside:
            self.same_names = self._read(nothing, marks)

    def _follow(self, readings: Readings, rival: Hypothesis, time_s: float, marks: Sequence[MarkMeasurement]) -> None:
        """What comes of a rival with this frame, and of names that are in doubt by what it knows."""
        predicted = self._at(rival, time_s)
        if predicted is None:
            return
        costs = self.namesakes.costs(self.tissue, marks)
        _keep(readings, self._read(predicted, marks))
        for names, n_changes in self._others(rival.names, costs, self.settings.decisive).items():
            if names not in readings:
                _keep(readings, self._read(self._changed(replace(predicted, since_s=time_s), names, n_changes), marks))

    def _at(self, rival: Hypothesis, time_s: float, then: Callable[[], object] = lambda: None) -> Hypothesis | None:
        """The rival at a later time [s], and after what is done then; None where its filter cannot follow."""
        self.tissue.restore(rival.knows)
        try:
            self.tissue.predict(time_s)
            then()
        except (CovarianceError, np.linalg.LinAlgError):
            return None
        return replace(rival, knows=self.tissue.snapshot())

    def _read(self, rival: Hypothesis, marks: Sequence[MarkMeasurement]) -> Hypothesis | None:
        """The rival after it took the marks in by its names; None where its filter cannot."""
        self.tissue.restore(rival.knows)
        try:
            estimate = self.tissue.update(renamed(marks, self.namesakes.by_node(rival.names)))
        except (CovarianceError, np.linalg.LinAlgError):
            return None
        ahead = rival.ahead + self.tissue.log_likelihood
        return replace(rival, ahead=ahead, knows=self.tissue.snapshot(), estimate=estimate) if isfinite(ahead) else None

    def _decided(self, readings: Readings, marks: Sequence[MarkMeasurement]) -> AssociatedEstimate:
        """Believe the best names if they are clearly so, and keep those that are not clearly worse."""
        own, settings = self.namesakes.own, self.settings
        best = _best(readings)
        same = 0.0 if self.same_names is None else max(0.0, self.same_names.ahead)
        if best.ahead <= same + settings.decisive or best.estimate.status is not Status.TRACKING:
            best = readings[own]
        self.tissue.restore(best.knows)
        now_s, nodes = best.estimate.time_s, self.namesakes.by_node(best.names)
        worst = max(best.ahead, same) - settings.exchange - 2.0 * settings.decisive
        kept = [
            replace(one, names=seen_from(one.names, best.names), ahead=one.ahead - best.ahead)
            for one in readings.values()
            if one is not best and one.ahead >= worst and now_s - one.since_s <= settings.longest_s
        ]
        self.rivals = sorted(kept, key=lambda one: -one.ahead)[: settings.max_hypotheses]
        swap = None
        if best.names != own:
            swap = IdentitySwap(now_s, best.since_s, tuple(node for node, other in nodes.items() if node != other))
            self.swaps.append(swap)
            self.called = {node: nodes[self.called.get(node, node)] for node in nodes}
        if swap is not None or not self.rivals:
            self.same_names = None
        return AssociatedEstimate(best.estimate, renamed(marks, nodes), swap)


def _best(readings: Readings) -> Hypothesis:
    return max(readings.values(), key=lambda one: one.ahead)


def _keep(readings: Readings, one: Hypothesis | None) -> None:
    """Of two ways to the same names, the more probable."""
    if one is not None and (one.names not in readings or one.ahead > readings[one.names].ahead):
        readings[one.names] = one
