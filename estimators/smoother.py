"""What the marks that came later say of an earlier time: fixed-interval and fixed-lag smoothing of the mixture.

Backward in time each mode hands to the modes before it a Gaussian likelihood of the state, exp(x'l - x'L x / 2) about
that mode's mix; a pair of modes is weighed by its odds and by how well that likelihood meets the earlier mode's belief.
With one mode this is Rauch, Tung and Striebel's smoother. Sources: [rauch1965], [koch2000].
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.estimate import MarkMeasurement, TargetEstimate
from estimators.mixture import Beliefs, Transition, mixed
from estimators.tissue import TissueFilter

Floats = NDArray[np.float64]
Frames = Iterable[tuple[float, Sequence[MarkMeasurement]]]


@dataclass(frozen=True, slots=True, eq=False)
class Passed:
    """What a filter knew at one frame, and how it came there.

    estimate: the filter's own; filtered: its beliefs, mode by mode
    cycles: the predictions that led here from the frame before; None where the filter started anew: what is known here
        says nothing of earlier
    considered: what constants not known add to the target's covariance [m²], (dim, dim)
    """

    estimate: TargetEstimate
    filtered: Beliefs
    cycles: tuple[Transition, ...] | None
    considered: Floats


class Passage:
    """A filter on its way through frames, with what a smoother needs of each.

    State: the filter and how often it was restarted.
    """

    def __init__(self, tissue: TissueFilter) -> None:
        self.tissue = tissue
        self._restarts = 0

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> Passed:
        """The filter's estimate at this exposure time [s], and what led to it; raises ValueError as the filter does."""
        mixture = self.tissue.mixture
        first = self.tissue.seen_s is None
        mixture.trace = []
        try:
            self.tissue.predict(time_s)
            cycles = tuple(mixture.trace)
        finally:
            mixture.trace = None
        estimate = self.tissue.update(marks)
        restarts = self.tissue.repairs["restarted"]
        anew = first or restarts != self._restarts
        self._restarts = restarts
        columns = np.einsum("k,kij->ij", mixture.mu, mixture.columns[:, self.tissue.target])
        return Passed(estimate, mixture.beliefs(), None if anew else cycles, columns @ columns.T)


def fixed_interval(tissue: TissueFilter, frames: Frames) -> list[TargetEstimate]:
    """The target at each frame, given the marks of all frames: (time [s], marks) in order."""
    passage = Passage(tissue)
    passed = [passage.take(time_s, marks) for time_s, marks in frames]
    return [_told(one, known, tissue.target) for one, known in zip(passed, smoothed(passed), strict=True)]


class FixedLag:
    """The target some time ago, given all marks until now.

    lag_s: how long ago, at least [s]
    State: the passage of the filter, and the frames of the last lag_s.
    """

    def __init__(self, tissue: TissueFilter, lag_s: float = 0.3) -> None:
        if not lag_s >= 0:
            raise ValueError(f"lag_s: expected 0 s or more, found {lag_s}")
        self.lag_s = lag_s
        self._passage = Passage(tissue)
        self._passed: deque[Passed] = deque()

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> TargetEstimate | None:
        """The target at the newest frame that is lag_s or more old; None while there is none."""
        self._passed.append(self._passage.take(time_s, marks))
        due_s = time_s - self.lag_s
        while len(self._passed) > 1 and self._passed[1].estimate.time_s <= due_s:
            self._passed.popleft()
        if self._passed[0].estimate.time_s > due_s:
            return None
        return _told(self._passed[0], smoothed(tuple(self._passed))[0], self._passage.tissue.target)


def smoothed(passed: Sequence[Passed]) -> list[Beliefs]:
    """What all frames say of the state at each of them; none may be missing between."""
    known = [passed[-1].filtered] if passed else []
    for before, one in zip(reversed(passed[:-1]), reversed(passed), strict=False):
        now = known[-1]
        if one.cycles is None:
            known.append(before.filtered)
            continue
        starts = [before.filtered, *(cycle.arrived for cycle in one.cycles[:-1])]
        for start, cycle in zip(reversed(starts), reversed(one.cycles), strict=False):
            now = smoothed_before(now, cycle, start)
        known.append(now)
    return known[::-1]


def _told(one: Passed, known: Beliefs, target: slice) -> TargetEstimate:
    mean, cov = mixed(known.mu, known.means[:, target], known.covs[:, target, target])
    return replace(one.estimate, mean=mean, cov=cov + one.considered, poked=float(known.mu[-1]))


def smoothed_before(after: Beliefs, cycle: Transition, before: Beliefs) -> Beliefs:
    """Beliefs at the start of a cycle, given those that all marks give at its end.

    after: smoothed, at the end; before: filtered, at the start.
    """
    predicted = cycle.arrived
    k, n = before.means.shape
    logs = np.full((k, k), -np.inf)
    means, covs = np.empty((k, k, n)), np.empty((k, k, n, n))
    identity = np.eye(n)
    for j in range(k):
        gain = np.linalg.solve(predicted.covs[j], cycle.F[j]).T  # F' P^-1
        told = gain @ (predicted.covs[j] - after.covs[j]) @ gain.T
        toward = gain @ (after.means[j] - predicted.means[j])
        # of the smoothed moments of the mix: the likelihood that makes them of the mix
        back = identity - told @ cycle.covs[j]
        L = np.linalg.solve(back, told)
        L = 0.5 * (L + L.T)
        pull = np.linalg.solve(back, toward)
        for i in range(k):
            off = before.means[i] - cycle.means[j]
            S = identity + before.covs[i] @ L
            slope = pull - L @ off
            cov = np.linalg.solve(S, before.covs[i])
            cov = 0.5 * (cov + cov.T)
            means[i, j], covs[i, j] = before.means[i] + cov @ slope, cov
            log_det = np.linalg.slogdet(S)[1]
            logs[i, j] = off @ pull - 0.5 * off @ L @ off + 0.5 * slope @ cov @ slope - 0.5 * log_det
    weights = cycle.weights * np.exp(logs - logs.max(axis=0))
    weights *= after.mu / weights.sum(axis=0)
    mu = weights.sum(axis=1)
    share = weights / mu[:, None]
    joined = np.einsum("ij,ijn->in", share, means)
    away = means - joined[:, None, :]
    spread = np.einsum("ij,ijab->iab", share, covs) + np.einsum("ij,ija,ijb->iab", share, away, away)
    return Beliefs(mu, joined, spread)
