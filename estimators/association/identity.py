"""Identification of interchangeable marks. While names are uncertain, each hypothesis about names has a filter."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from estimators.arrays import Floats
from estimators.association.exchanges import InterchangeableMarks, Names, renamed, seen_from
from estimators.association.settings import IdentitySettings
from estimators.core.track import FilterSnapshot, TissueFilter
from estimators.filters.unscented import CovarianceError
from estimators.tissue.estimate import MarkMeasurement, Status, TargetEstimate


@dataclass(frozen=True, slots=True)
class IdentitySwap:
    """An exchange of marks that was detected and corrected.

    time_s: time of the correction [s]; since_s: time when the exchange began [s]; nodes: nodes of the exchanged marks
    """

    time_s: float
    since_s: float
    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class AssociatedEstimate:
    """Result of a frame: estimate, marks with corrected names, and the corrected exchange of marks (or None)."""

    estimate: TargetEstimate
    marks: tuple[MarkMeasurement, ...]
    swap: IdentitySwap | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Alternative names of the marks, and the filter's state under these names.

    ahead: log odds of these names, relative to the present names
    since_s: time when this alternative began [s]
    """

    names: Names
    ahead: float
    since_s: float
    state: FilterSnapshot
    estimate: TargetEstimate


Hypotheses = dict[Names, Hypothesis]


class AssociationFilter:
    """Filter for interchangeable marks. It adopts other names of the marks if these are decisively more probable.

    The names are the state of a hidden Markov model. In each frame, every plausible exchange of two names becomes an
    alternative, which is a copy of the filter with the exchanged names. If two alternatives have the same names, the
    more probable one is kept (Viterbi's algorithm). The probability of an alternative is the product of the likelihoods
    of its marks and of the prior odds of its exchanges. Improbable alternatives are dropped. An alternative with the
    status TRACKING replaces the present names and filter if it is much more probable than the present names.

    At the start, after a divergence, and when marks are rejected, several filters restart. Each has names for which the
    marks fit the rest shape well. Since the tissue may be displaced, this fit changes the log odds by at most
    `settings.decisive`. A restart alone may make marks more probable, because it enlarges the covariance. Therefore one
    more filter restarts with the present names, and an alternative must be much more probable than that filter, too.

    tissue: the filter; in each frame, call `tissue.predict` before `update`
    groups: groups of nodes with interchangeable marks; names are never exchanged between groups
    State: node_of, map from a mark's name to the node that the mark is on, empty before a correction; alternatives;
    same_names, the filter that restarted with the present names; swaps, the corrected exchanges; times of restarts.
    """

    def __init__(
        self, tissue: TissueFilter, groups: Iterable[Collection[str]], settings: IdentitySettings | None = None
    ) -> None:
        self.tissue = tissue
        self.settings = IdentitySettings() if settings is None else settings
        self.interchangeable = InterchangeableMarks(tissue, groups)
        self.node_of: dict[str, str] = {}
        self.alternatives: list[Hypothesis] = []
        self.swaps: list[IdentitySwap] = []
        self.same_names: Hypothesis | None = None
        self._next_s, self._pause_s = -np.inf, self._shortest_pause_s

    def named(self, marks: Sequence[MarkMeasurement]) -> tuple[MarkMeasurement, ...]:
        """The tracker's marks, each with the name of the node that the mark is on."""
        return renamed(marks, self.node_of)

    def fix(self, position: Floats, cov: Floats) -> TargetEstimate:
        """Update the present filter and all alternatives with a direct measurement of the target.

        position: measured position [m], (dim,); cov: covariance of the measured position [m²], (dim, dim)
        """
        tissue = self.tissue
        estimate = tissue.fix(position, cov)
        now = tissue.snapshot()
        same = [] if self.same_names is None else [self.same_names]
        fixed = [
            self._predicted(one, estimate.time_s, lambda: tissue.fix(position, cov))
            for one in (*self.alternatives, *same)
        ]
        tissue.restore(now)
        self.same_names = fixed[-1] if same else None
        self.alternatives = [one for one in fixed[: len(self.alternatives)] if one is not None]
        return estimate

    def update(self, marks: Sequence[MarkMeasurement]) -> AssociatedEstimate:
        """Update with the marks of a frame at the filter's time. The marks must have the names that `named` gives them.

        Raises the errors of `TissueFilter.update`.
        """
        tissue, groups = self.tissue, self.interchangeable
        before = tissue.snapshot()
        starting = tissue.health.since_s is None or tissue.health.status is Status.LOST
        others = {} if starting else self._others(groups.own, groups.costs(tissue, marks), self.settings.decisive)
        estimate = tissue.update(marks)
        if starting:
            self.alternatives, self.same_names = [], None
        try_all = starting or self._uncertain(estimate, marks)
        if not others and not self.alternatives and not try_all:
            return AssociatedEstimate(estimate, tuple(marks))
        present = Hypothesis(groups.own, 0.0, estimate.time_s, tissue.snapshot(), estimate)
        log_likelihood = tissue.log_likelihood
        hypotheses = {groups.own: present}
        start = replace(present, ahead=-log_likelihood, state=before)
        for names, n_changes in others.items():
            _keep(hypotheses, self._updated(self._changed(start, names, n_changes), marks))
        for alternative in self.alternatives:
            self._follow(
                hypotheses, replace(alternative, ahead=alternative.ahead - log_likelihood), estimate.time_s, marks
            )
        if self.same_names is not None:
            same = self._predicted(self.same_names, estimate.time_s)
            self.same_names = same and self._updated(replace(same, ahead=same.ahead - log_likelihood), marks)
        best = _best(hypotheses)
        if try_all and not (best.ahead > self.settings.decisive and best.estimate.status is not Status.DIVERGED):
            nothing = replace(start, ahead=best.ahead, state=before.without_marks())
            self._restart(hypotheses, nothing, marks, beside=not starting)
        return self._decided(hypotheses, marks)

    @property
    def _shortest_pause_s(self) -> float:
        """Shortest time between two restarts [s]. Within this time, a filter with wrong names diverges."""
        return 2.0 * self.tissue.settings.test_s

    @property
    def _least_ahead(self) -> float:
        """Log odds, relative to the best names, below which an alternative is dropped."""
        return -self.settings.exchange - 2.0 * self.settings.decisive

    def _others(self, names: Names, costs: Floats, worst: float) -> Mapping[Names, int]:
        return self.interchangeable.others(names, costs, worst, self.settings.max_hypotheses)

    def _changed(self, alternative: Hypothesis, names: Names, n_changes: int) -> Hypothesis:
        """The alternative with other names but the same state, after `n_changes` exchanges of two names."""
        return replace(alternative, names=names, ahead=alternative.ahead - n_changes * self.settings.exchange)

    def _uncertain(self, estimate: TargetEstimate, marks: Sequence[MarkMeasurement]) -> bool:
        """Whether to restart with other names because marks are rejected; False during the pause after a restart."""
        now_s, seen = estimate.time_s, {mark.node for mark in marks}.intersection(self.interchangeable.nodes)
        refuted = estimate.status is Status.DIVERGED or not seen <= estimate.information_share.keys()
        if now_s < self._next_s or not refuted:
            return False
        if now_s - self._next_s > self._pause_s:
            self._pause_s = self._shortest_pause_s
        self._next_s = now_s + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, self.settings.longest_s)
        return True

    def _restart(
        self, hypotheses: Hypotheses, nothing: Hypothesis, marks: Sequence[MarkMeasurement], *, beside: bool
    ) -> None:
        """Restart one filter with each plausible assignment of names and, if `beside`, one with the present names."""
        costs = self.interchangeable.costs(self.tissue, marks, starting=True)
        own = self.interchangeable.own
        others, most = self._others(own, costs, np.inf), self.settings.decisive
        for names, n_changes in others.items():
            better = float(costs.trace() - costs[list(names), own].sum())
            start = replace(nothing, ahead=nothing.ahead + float(np.clip(better, -most, most)))
            _keep(hypotheses, self._updated(self._changed(start, names, n_changes), marks))
        if others and beside:
            self.same_names = self._updated(nothing, marks)

    def _follow(
        self, hypotheses: Hypotheses, alternative: Hypothesis, time_s: float, marks: Sequence[MarkMeasurement]
    ) -> None:
        """Update an alternative with this frame, and add alternatives with further plausible exchanges of names."""
        predicted = self._predicted(alternative, time_s)
        if predicted is None:
            return
        costs = self.interchangeable.costs(self.tissue, marks)
        _keep(hypotheses, self._updated(predicted, marks))
        for names, n_changes in self._others(alternative.names, costs, self.settings.decisive).items():
            if names not in hypotheses:
                _keep(
                    hypotheses,
                    self._updated(self._changed(replace(predicted, since_s=time_s), names, n_changes), marks),
                )

    def _predicted(
        self, alternative: Hypothesis, time_s: float, then: Callable[[], object] = lambda: None
    ) -> Hypothesis | None:
        """Predict the alternative to a later time [s], then call the function `then`. If this fails, return None."""
        self.tissue.restore(alternative.state)
        try:
            self.tissue.predict(time_s)
            then()
        except (CovarianceError, np.linalg.LinAlgError):
            return None
        return replace(alternative, state=self.tissue.snapshot())

    def _updated(self, alternative: Hypothesis, marks: Sequence[MarkMeasurement]) -> Hypothesis | None:
        """Update the alternative; returns None if the filter fails or if the marks are too improbable."""
        self.tissue.restore(alternative.state)
        seen = renamed(marks, self.interchangeable.by_node(alternative.names))
        try:
            if alternative.ahead + self.tissue.log_likelihood_of(seen) < self._least_ahead:
                return None
            estimate = self.tissue.update(seen)
        except (CovarianceError, np.linalg.LinAlgError):
            return None
        ahead = alternative.ahead + self.tissue.log_likelihood
        return (
            replace(alternative, ahead=ahead, state=self.tissue.snapshot(), estimate=estimate)
            if isfinite(ahead)
            else None
        )

    def _decided(self, hypotheses: Hypotheses, marks: Sequence[MarkMeasurement]) -> AssociatedEstimate:
        """Adopt the best names if they are decisively better; drop the alternatives that are decisively worse."""
        own, settings = self.interchangeable.own, self.settings
        best = _best(hypotheses)
        same = 0.0 if self.same_names is None else max(0.0, self.same_names.ahead)
        if best.ahead <= same + settings.decisive or best.estimate.status is not Status.TRACKING:
            best = hypotheses[own]
        self.tissue.restore(best.state)
        now_s, nodes = best.estimate.time_s, self.interchangeable.by_node(best.names)
        worst = max(best.ahead, same) + self._least_ahead
        kept = [
            replace(one, names=seen_from(one.names, best.names), ahead=one.ahead - best.ahead)
            for one in hypotheses.values()
            if one is not best and one.ahead >= worst and now_s - one.since_s <= settings.longest_s
        ]
        self.alternatives = sorted(kept, key=lambda one: -one.ahead)[: settings.max_hypotheses]
        swap = None
        if best.names != own:
            swap = IdentitySwap(now_s, best.since_s, tuple(node for node, other in nodes.items() if node != other))
            self.swaps.append(swap)
            self.node_of = {node: nodes[self.node_of.get(node, node)] for node in nodes}
        if swap is not None or not self.alternatives:
            self.same_names = None
        return AssociatedEstimate(best.estimate, renamed(marks, nodes), swap)


def _best(hypotheses: Hypotheses) -> Hypothesis:
    return max(hypotheses.values(), key=lambda one: one.ahead)


def _keep(hypotheses: Hypotheses, one: Hypothesis | None) -> None:
    """Add a hypothesis. Of two hypotheses with the same names, only the more probable one is kept."""
    if one is not None and (one.names not in hypotheses or one.ahead > hypotheses[one.names].ahead):
        hypotheses[one.names] = one
