"""Fixed-interval and fixed-lag smoothing of the mixture: an earlier state given the marks that came later, too.

Backward in time each mode hands to the modes before it a Gaussian likelihood of the state; a pair of modes is weighed
by its odds and by how well that likelihood meets the earlier mode's state.
With one mode this is Rauch, Tung and Striebel's smoother. Sources: [rauch1965], [koch2000].
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estimators.arrays import Floats
from estimators.core.track import UnifiedFilter
from estimators.filters.gaussians import moment_matched
from estimators.filters.kernels import gains, met, roots_each
from estimators.filters.motion import ModeBeliefs, Transition
from estimators.filters.unscented import CovarianceError
from estimators.smoothing.unified import UnifiedPass
from estimators.tissue.estimate import MarkMeasurement, TargetEstimate
from estimators.tissue.filter import TissueFilter

RESTARTS = ("restarted", "inflated", "forgotten")
"""Repairs of a filter across which nothing is known backwards."""

CERTAIN = 1.0 - 1e-12
"""Part of a variance that later marks may take away at most: the rest is rounding."""

Frames = Iterable[tuple[float, Sequence[MarkMeasurement]]]

TimedFix = tuple[float, Floats, Floats]
"""A direct sighting of the target: when [s], where [m], (dim,), and its covariance [m²], (dim, dim)."""


@dataclass(frozen=True, slots=True, eq=False)
class FilteredStep:
    """The state of a filter at one frame, and the predictions that led there.

    estimate: the filter's own; filtered: its states, mode by mode
    cycles: the predictions that led here from the frame before; None where the filter restarted: its state holds
        no information on earlier ones
    considered: what constants not known add to the target's covariance [m²], (dim, dim)
    """

    estimate: TargetEstimate
    filtered: ModeBeliefs
    cycles: tuple[Transition, ...] | None
    considered: Floats


class ForwardPass:
    """A filter on its way through frames, with what a smoother needs of each; raises TypeError for another filter.

    State: the filter and how often it was restarted.
    """

    def __init__(self, tissue: TissueFilter) -> None:
        if not isinstance(tissue, TissueFilter):
            raise TypeError(f"smoothing: expected a TissueFilter, found {type(tissue).__name__}")
        self.tissue = tissue
        self._restarts = 0

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> FilteredStep:
        """The filter's estimate at this exposure time [s], and what led to it; raises ValueError as the filter does."""
        return self._taken(time_s, lambda: self.tissue.update(marks))

    def fix(self, fix: TimedFix) -> FilteredStep:
        """The same of a direct sighting of the target."""
        time_s, position, cov = fix
        return self._taken(time_s, lambda: self.tissue.fix(position, cov))

    def _taken(self, time_s: float, update: Callable[[], TargetEstimate]) -> FilteredStep:
        mixture = self.tissue.mixture
        first = self.tissue.seen_s is None
        mixture.trace = []
        try:
            self.tissue.predict(time_s)
            estimate = update()
            cycles = tuple(mixture.trace)
        finally:
            mixture.trace = None
        restarts = sum(self.tissue.repairs[kind] for kind in RESTARTS)
        restarted = first or restarts != self._restarts
        self._restarts = restarts
        columns = self.tissue.target.linear(mixture.mean_columns)
        return FilteredStep(estimate, mixture.beliefs(), None if restarted else cycles, columns @ columns.T)

    def smoothed(self, passed: Sequence[FilteredStep], advance: Callable[[float], None]) -> list[TargetEstimate]:
        """The target at each step, given all of them; advance: gets the share done."""
        known = smooth(passed, advance)
        return [_reported(one, state, self.tissue) for one, state in zip(passed, known, strict=True)]


def fixed_interval(
    tissue: TissueFilter | UnifiedFilter,
    frames: Frames,
    advance: Callable[[float], None] = lambda _share: None,
    *,
    fixes: Iterable[TimedFix] = (),
) -> list[TargetEstimate]:
    """The target at each frame, given the marks of all frames: (time [s], marks) in order, and all fixes.

    advance: gets the share done, half of it forth, half back. fixes: used at their times; one before the first marks
    or after the last frame is not.
    """
    passage: ForwardPass | UnifiedPass = (
        UnifiedPass(tissue) if isinstance(tissue, UnifiedFilter) else ForwardPass(tissue)
    )
    taken, waiting = list(frames), deque(sorted(fixes, key=lambda fix: fix[0]))
    passed: list[Any] = []
    of_frames: list[int] = []
    for time_s, marks in taken:
        while waiting and waiting[0][0] <= time_s:
            fix = waiting.popleft()
            if tissue.seen_s is not None:
                passed.append(passage.fix(fix))
        of_frames.append(len(passed))
        passed.append(passage.take(time_s, marks))
        advance(0.5 * len(of_frames) / len(taken))
    known = passage.smoothed(passed, lambda share: advance(0.5 + 0.5 * share))
    return [known[k] for k in of_frames]


class FixedLag:
    """The target some time ago, given all marks until now.

    lag_s: how long ago, at least [s]
    State: the passage of the filter, and the frames of the last lag_s.
    """

    def __init__(self, tissue: TissueFilter, lag_s: float = 0.3) -> None:
        if not lag_s >= 0:
            raise ValueError(f"lag_s: expected 0 s or more, found {lag_s}")
        self.lag_s = lag_s
        self._passage = ForwardPass(tissue)
        self._passed: deque[FilteredStep] = deque()

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> TargetEstimate | None:
        """The target at the newest frame that is lag_s or more old; None while there is none."""
        self._passed.append(self._passage.take(time_s, marks))
        due_s = time_s - self.lag_s
        while len(self._passed) > 1 and self._passed[1].estimate.time_s <= due_s:
            self._passed.popleft()
        if self._passed[0].estimate.time_s > due_s:
            return None
        return _reported(self._passed[0], smooth(tuple(self._passed))[0], self._passage.tissue)


def smooth(passed: Sequence[FilteredStep], advance: Callable[[float], None] = lambda _share: None) -> list[ModeBeliefs]:
    """The state at each frame given all of them; none may be missing between. advance: gets the share done."""
    known = [passed[-1].filtered] if passed else []
    for before, one in zip(reversed(passed[:-1]), reversed(passed), strict=False):
        advance(len(known) / len(passed))
        now = known[-1]
        if one.cycles is None:
            known.append(before.filtered)
            continue
        starts = [before.filtered, *(cycle.arrived for cycle in one.cycles[:-1])]
        for start, cycle in zip(reversed(starts), reversed(one.cycles), strict=False):
            now = smoothed_before(now, cycle, start)
        known.append(now)
    advance(1.0)
    return known[::-1]


def _reported(one: FilteredStep, known: ModeBeliefs, tissue: TissueFilter) -> TargetEstimate:
    target, poked = tissue.target, tissue.settings.poked_share(known.mu)
    mean, cov = moment_matched(known.mu, target.position(known.means), target.cov(known.covs))
    return replace(one.estimate, mean=mean, cov=cov + one.considered, poked=poked)


def smoothed_before(after: ModeBeliefs, cycle: Transition, before: ModeBeliefs) -> ModeBeliefs:
    """Beliefs at the start of a cycle, given those that all marks give at its end.

    after: smoothed, at the end; before: filtered, at the start.
    """
    (roots, definite), (mix_roots, mix_definite) = roots_each(before.covs), roots_each(cycle.covs)
    _check(definite and mix_definite)
    N, pull = _likelihoods(after, cycle, mix_roots)
    logs, means, covs, definite = met(before.means, roots, cycle.means, mix_roots, N, pull)
    _check(definite)
    weights = cycle.weights * np.exp(logs - logs.max(axis=0))
    weights *= after.mu / weights.sum(axis=0)
    mu = weights.sum(axis=1)
    share = weights / mu[:, None]
    joined = np.einsum("ij,ijn->in", share, means)
    away = means - joined[:, None, :]
    spread = np.einsum("ij,ijab->iab", share, covs) + np.einsum("ij,ija,ijb->iab", share, away, away)
    return ModeBeliefs(mu, joined, 0.5 * (spread + spread.swapaxes(1, 2)))


def _likelihoods(after: ModeBeliefs, cycle: Transition, roots: Floats) -> tuple[Floats, Floats]:
    """Likelihood exp(y'n - y'N y / 2) of later marks by each mode: N (k, n, n) and n (k, n).

    Given y, (x - mix's mean) by the root of the mix's covariance, (k, n, n). It takes the mix, N(0, 1) in y, to the
    smoothed moments of Rauch, Tung and Striebel: N(m / (1 - M), 1 - M) with M between 0 and 1. Beyond these bounds,
    where merging modes has made the end less sure than was predicted, it is taken to hold no information.
    """
    predicted = cycle.arrived
    gain, M, definite = gains(roots, predicted.covs, cycle.F, after.covs)
    _check(definite)
    values, axes = np.linalg.eigh(0.5 * (M + M.mT))
    shares = np.where(values > 0.0, np.minimum(values, CERTAIN), 0.0)
    moved = np.einsum("jab,jb->ja", gain, after.means - predicted.means)
    toward = np.einsum("jba,jb->ja", axes, moved)
    pull = np.where(values > 0.0, toward / (1.0 - shares), 0.0)
    weighted = axes * (shares / (1.0 - shares))[:, None, :]
    return np.einsum("jac,jbc->jab", weighted, axes), np.einsum("jab,jb->ja", axes, pull)


def _check(definite: bool) -> None:
    if not definite:
        raise CovarianceError("smoothed covariance: expected positive definite, found otherwise")
