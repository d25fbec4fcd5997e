"""Fixed-interval and fixed-lag smoothing: estimates of the target from earlier and later marks.

The Rauch-Tung-Striebel smoother treats the filter's mixture as one Gaussian with the same mean and covariance. This is
possible because the transition matrix is the same for all modes of the unknown forces. Source: [rauch1965].
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.core.moments import Move
from estimators.core.track import TissueFilter
from estimators.tissue.estimate import MarkMeasurement, TargetEstimate

SINGULAR = 1e-12
"""Addition to the diagonal of a predicted correlation matrix before its inversion [1]; numerical."""

Frames = Iterable[tuple[float, Sequence[MarkMeasurement]]]

TimedFix = tuple[float, Floats, Floats]
"""A direct measurement of the target: time [s], position [m], (dim,), covariance [m²], (dim, dim)."""


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Record of one frame in the forward pass.

    mean, cov: mean (n,) and covariance (n, n) of the state after the frame
    moves: the predictions since the last frame; None if the filter started or restarted in this frame
    """

    mean: Floats
    cov: Floats
    moves: Sequence[Move] | None


class ForwardPass:
    """Filter that records a `Step` for each frame."""

    def __init__(self, tissue: TissueFilter) -> None:
        self.tissue = tissue

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> tuple[TargetEstimate, Step]:
        """Update with the marks of a frame; returns the filter's estimate and the `Step` for a smoother.

        Raises the errors of `TissueFilter.predict` and `TissueFilter.update`; then the tissue is as before.
        """
        return self._taken(time_s, lambda: self.tissue.update(marks))

    def fix(self, fix: TimedFix) -> tuple[TargetEstimate, Step]:
        """Update with a direct measurement of the target; returns the filter's estimate and a `Step`.

        Raises the errors of `TissueFilter.predict` and `TissueFilter.fix`; then the tissue is as before.
        """
        time_s, position, cov = fix
        return self._taken(time_s, lambda: self.tissue.fix(position, cov))

    def _taken(self, time_s: float, update: Callable[[], TargetEstimate]) -> tuple[TargetEstimate, Step]:
        before, is_begun, moves = self.tissue.filter, self.tissue.seen_s is not None, list[Move]()
        then = self.tissue.snapshot()
        before.trace = moves
        try:
            self.tissue.predict(time_s)
            estimate = update()
        except BaseException:
            self.tissue.restore(then)
            raise
        finally:
            before.trace = None
        own = self.tissue.filter  # a restart replaces it
        return estimate, Step(*own.moments_by(own.weights), moves if own is before and is_begun else None)

    def smoothed(self, steps: Iterable[Step]) -> Iterator[tuple[Floats, Floats]]:
        """Smoothed mean [m], (dim,), and covariance [m²] of the target. Steps and results begin with the last step."""
        target = self.tissue.target
        rows = self.tissue.rows_of(target)
        for mean, cov in smooth(steps, self.tissue.process.considered):
            yield rows @ mean + target.constant, rows @ cov @ rows.T


def fixed_interval(
    tissue: TissueFilter,
    frames: Frames,
    advance: Callable[[float], None] = lambda _share: None,
    *,
    fixes: Iterable[TimedFix] = (),
) -> list[TargetEstimate]:
    """Estimate the target at each frame from all frames and all fixes.

    frames: time [s] and marks of each frame, in order of time
    advance: called with the share of the computation that is done
    fixes: direct measurements of the target. Fixes before the first marks or after the last frame are ignored.
    """
    passage, taken = ForwardPass(tissue), list(frames)
    waiting = deque(sorted(fixes, key=lambda fix: fix[0]))
    passed: list[tuple[TargetEstimate | None, Step]] = []  # None: a fix, for which no estimate is returned

    def use_fixes(until_s: float, *, inclusive: bool) -> None:
        while waiting and (waiting[0][0] < until_s or (inclusive and waiting[0][0] == until_s)):
            fix = waiting.popleft()
            if tissue.seen_s is not None:
                passed.append((None, passage.fix(fix)[1]))

    for k, (time_s, marks) in enumerate(taken, start=1):
        use_fixes(time_s, inclusive=False)
        passed.append(passage.take(time_s, marks))
        use_fixes(time_s, inclusive=True)  # after the marks, because the filter starts with marks
        advance(0.5 * k / len(taken))
    found: list[TargetEstimate] = []
    for (estimate, _), (mean, cov) in zip(
        reversed(passed), passage.smoothed(step for _, step in reversed(passed)), strict=True
    ):
        if estimate is not None:
            found.append(replace(estimate, mean=mean, cov=cov))
            advance(0.5 + 0.5 * len(found) / len(taken))
    return found[::-1]


class FixedLag:
    """Smoother that estimates the target with a delay. Each estimate uses all marks up to the newest frame.

    lag_s: smallest delay [s]
    State: the forward pass, and its frames within the last lag_s.
    """

    def __init__(self, tissue: TissueFilter, lag_s: float = 0.3) -> None:
        if not lag_s >= 0:
            raise ValueError(f"lag_s: expected 0 s or more, found {lag_s}")
        self.lag_s = lag_s
        self._passage = ForwardPass(tissue)
        self._passed: deque[tuple[TargetEstimate, Step]] = deque()

    def take(self, time_s: float, marks: Sequence[MarkMeasurement]) -> TargetEstimate | None:
        """Use the marks of a frame. Returns the target at the newest frame with an age of at least lag_s, else None."""
        self._passed.append(self._passage.take(time_s, marks))
        due_s = time_s - self.lag_s
        while len(self._passed) > 1 and self._passed[1][0].time_s <= due_s:
            self._passed.popleft()
        estimate = self._passed[0][0]
        if estimate.time_s > due_s:
            return None
        *_, (mean, cov) = self._passage.smoothed(step for _, step in reversed(self._passed))
        return replace(estimate, mean=mean, cov=cov)


def smooth(steps: Iterable[Step], considered: NDArray[np.int64]) -> Iterator[tuple[Floats, Floats]]:
    """Smoothed mean (n,) and covariance (n, n) of the state at each step. Steps and results begin with the last step.

    considered: indices of the states that no observation corrects
    """
    mean, cov = np.empty(0), np.empty(0)
    moves: Sequence[Move] | None = None
    for one in steps:
        if moves is None:  # no later step depends on this one
            mean, cov = one.mean, one.cov
        else:
            for move in reversed(moves):
                mean, cov = smoothed_before(mean, cov, move, considered)
        moves = one.moves
        yield mean, cov


def smoothed_before(mean: Floats, cov: Floats, move: Move, considered: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Smoothed mean (n,) and covariance (n, n) before a prediction, from the smoothed mean and covariance after it.

    considered: indices of the states that no observation corrects
    """
    sd = np.sqrt(move.cov.diagonal())
    sd = np.where(sd > 0.0, sd, 1.0)
    scaled = move.cov / np.outer(sd, sd) + SINGULAR * np.eye(len(sd))
    gain = np.linalg.solve(scaled, (move.matrix @ move.cov_before) / sd[:, None]).T / sd
    gain[considered] = 0.0
    before = move.cov_before + gain @ (cov - move.cov) @ gain.T
    return move.mean_before + gain @ (mean - move.mean), 0.5 * (before + before.T)
