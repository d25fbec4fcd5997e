"""Fixed-interval smoothing of the unified filter: Rauch, Tung and Striebel's pass over the moments of its mixture.

All modes share the transition, so the mixture moves as one Gaussian with its mean and covariance. Source: [rauch1965].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.core.filter import Move
from estimators.core.track import UnifiedFilter
from estimators.tissue.estimate import MarkMeasurement, TargetEstimate

SINGULAR = 1e-12
"""Added to the correlations of a prediction before they are inverted [1]; numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class UnifiedStep:
    """At a frame: the filter's estimate, mean (n,) and covariance (n, n) of its state, and the moves that led there.

    moves: none where the filter began: its state holds no information on earlier ones
    """

    estimate: TargetEstimate
    mean: Floats
    cov: Floats
    moves: Sequence[Move]


class UnifiedPass:
    """A filter on its way through frames, with what a smoother needs of each. State: the filter."""

    def __init__(self, tissue: UnifiedFilter) -> None:
        self.tissue = tissue

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> UnifiedStep:
        """The filter's estimate at this exposure time [s], and what led to it; raises ValueError as the filter does."""
        return self._taken(time_s, lambda: self.tissue.update(marks))

    def fix(self, fix: tuple[float, Floats, Floats]) -> UnifiedStep:
        """The same of a direct sighting of the target: time [s], place [m] (dim,), covariance [m²] (dim, dim)."""
        time_s, position, cov = fix
        return self._taken(time_s, lambda: self.tissue.fix(position, cov))

    def _taken(self, time_s: float, update: Callable[[], TargetEstimate]) -> UnifiedStep:
        before, is_begun, moves = self.tissue.filter, self.tissue.seen_s is not None, list[Move]()
        before.trace = moves
        try:
            self.tissue.predict(time_s)
            estimate = update()
        finally:
            before.trace = None
        own = self.tissue.filter  # another one where it began again
        return UnifiedStep(estimate, *own.moments_by(own.weights), moves if own is before and is_begun else [])

    def smoothed(self, passed: Sequence[UnifiedStep], advance: Callable[[float], None]) -> list[TargetEstimate]:
        """The target at each step, given all of them; advance: gets the share done."""
        target, considered = self.tissue.target, self.tissue.process.considered
        rows, found = self.tissue.rows_of(target), list[TargetEstimate]()
        mean, cov = np.empty(0), np.empty(0)
        moves: Sequence[Move] = ()
        for one in reversed(passed):
            if not moves:  # nothing later, or nothing that depends on this
                mean, cov = one.mean, one.cov
            for move in reversed(moves):
                mean, cov = smoothed_before(mean, cov, move, considered)
            moves = one.moves
            found.append(replace(one.estimate, mean=rows @ mean + target.constant, cov=rows @ cov @ rows.T))
            advance(len(found) / len(passed))
        return found[::-1]


def smoothed_before(mean: Floats, cov: Floats, move: Move, considered: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) before a move, given those that all observations leave after it.

    considered: states that no observation corrects
    """
    sd = np.sqrt(move.cov.diagonal())
    sd = np.where(sd > 0.0, sd, 1.0)
    scaled = move.cov / np.outer(sd, sd) + SINGULAR * np.eye(len(sd))
    gain = np.linalg.solve(scaled, (move.matrix @ move.cov_before) / sd[:, None]).T / sd
    gain[considered] = 0.0
    before = move.cov_before + gain @ (cov - move.cov) @ gain.T
    return move.mean_before + gain @ (mean - move.mean), 0.5 * (before + before.T)
