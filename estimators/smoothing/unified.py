"""Fixed-interval smoothing of the unified filter: Rauch, Tung and Striebel's pass over the moments of its mixture.

All modes share the transition, so the mixture moves as one Gaussian with its mean and covariance. Source: [rauch1965].
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.core.filter import Move
from estimators.core.track import UnifiedFilter
from estimators.tissue.estimate import MarkMeasurement, TargetEstimate

SINGULAR = 1e-12
"""Added to the correlations of a prediction before they are inverted [1]; numerical."""

Step = tuple[TargetEstimate, Floats, Floats, list[Move]]
"""At a frame: the filter's estimate, mean (n,) and covariance (n, n) of its state, and the moves that led there."""


def smoothed_path(
    tissue: UnifiedFilter,
    frames: Sequence[tuple[float, Sequence[MarkMeasurement]]],
    advance: Callable[[float], None],
    fixes: Iterable[tuple[float, Floats, Floats]],
) -> list[TargetEstimate]:
    """As `fixed_interval` does, by the unified filter."""
    waiting, steps, of_frames = deque(sorted(fixes, key=lambda fix: fix[0])), list[Step](), list[int]()
    for time_s, marks in frames:
        while waiting and waiting[0][0] <= time_s:
            fix_s, place, cov = waiting.popleft()
            if tissue.seen_s is not None:
                steps.append(_passed(tissue, fix_s, lambda p=place, c=cov: tissue.fix(p, c)))  # type: ignore[misc]
        of_frames.append(len(steps))
        steps.append(_passed(tissue, time_s, lambda m=marks: tissue.update(m)))  # type: ignore[misc]
        advance(0.5 * len(of_frames) / len(frames))
    rows, constant, found = tissue.rows_of(tissue.target), tissue.target.constant, list[TargetEstimate]()
    mean, cov, moves = np.empty(0), np.empty(0), list[Move]()
    for k, (estimate, own_mean, own_cov, own_moves) in enumerate(reversed(steps)):
        if moves:
            for move in reversed(moves):
                mean, cov = smoothed_before(mean, cov, move, tissue.process.considered)
        else:  # nothing later, or nothing that depends on this
            mean, cov = own_mean, own_cov
        moves = own_moves
        found.append(replace(estimate, mean=rows @ mean + constant, cov=rows @ cov @ rows.T))
        advance(0.5 + 0.5 * (k + 1) / len(steps))
    return [found[len(steps) - 1 - k] for k in of_frames]


def _passed(tissue: UnifiedFilter, time_s: float, update: Callable[[], TargetEstimate]) -> Step:
    before = tissue.filter
    moves = list[Move]()
    before.trace = moves
    is_begun = tissue.seen_s is not None
    tissue.predict(time_s)
    estimate = update()
    before.trace = None
    own = tissue.filter
    return estimate, *own.moments_by(own.weights), moves if own is before and is_begun else []


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
