"""An update of a motion that bends: the most probable start of a cycle, by Gauss-Newton steps that are shortened."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimators.arrays import Floats
from estimators.filters.kernels import measured
from estimators.filters.motion import Cycle, LinearMotion

SETTLED = 0.3
"""Standard deviations by which a start may still move for its linearisation to hold; numerical: where it moves by less
than it is uncertain, another pass is not worth its time."""

SHORTER = 0.25
"""Share of a step that is tried next where the whole one made the marks less probable; numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """A start of one mode: mean + P dual + columns errors, and minus twice its log probability given z."""

    dual: Floats
    errors: Floats
    cost: float

    def towards(self, other: _Start, share: float) -> _Start:
        """A share of the way to another; its cost is to be found."""
        return _Start(
            self.dual + share * (other.dual - self.dual), self.errors + share * (other.errors - self.errors), np.inf
        )


class IteratedStart:
    """Finds the starts of a cycle that z = H x + noise (R) makes the most probable, mode by mode.

    z (m,), H (m, n), R (m, m); considered: whether the columns count. Source: [jazwinski1970], section 8.3; steps are
    shortened until the probability grows, as in [skoglund2015].
    """

    def __init__(self, cycle: Cycle, z: Floats, H: Floats, R: Floats, *, considered: bool) -> None:
        self._z, self._H, self._R, self._considered = z, H, R, considered
        self._cycle, self._k = cycle, len(cycle.means)
        n_columns = cycle.columns.shape[2]
        self._starts = [_Start(np.zeros(cycle.means.shape[1]), np.zeros(n_columns), np.inf)] * self._k
        self._targets: list[_Start | None] = [None] * self._k
        self._shares = np.ones(self._k)

    def found(self) -> Cycle | None:
        """The cycle, linearised about these starts; None where it may stay as it is."""
        given = self._cycle
        for n_before in range(given.passes - 1):
            moves = [self._trial(j) for j in range(self._k)]
            if not any(moves):
                break
            if n_before == 0:
                self._starts = [self._judged(j, own, given.found) for j, own in enumerate(self._starts)]
            trials = [move or own for move, own in zip(moves, self._starts, strict=True)]
            about = np.array([self._place(j, trial) for j, trial in enumerate(trials)])
            if not np.isfinite(about).all():
                break
            motion = given.motion(about)
            judged = [self._judged(j, trial, motion) for j, trial in enumerate(trials)]
            better = np.array([one.cost < own.cost for one, own in zip(judged, self._starts, strict=True)])
            self._starts = [one if well else own for one, own, well in zip(judged, self._starts, better, strict=True)]
            self._targets = [None if well else target for target, well in zip(self._targets, better, strict=True)]
            self._shares = np.where(better, 1.0, SHORTER * self._shares)
            if better.any():
                kept = np.where(better[:, None], about, self._cycle.about)
                self._cycle = replace(self._cycle, about=kept, found=self._cycle.found.chosen(motion, better))
        return None if self._cycle is given else self._cycle

    def _place(self, j: int, start: _Start) -> Floats:
        cycle = self._cycle
        return np.asarray(cycle.means[j] + cycle.covs[j] @ start.dual + cycle.columns[j] @ start.errors)

    def _trial(self, j: int) -> _Start | None:
        """What to try next; None where the motion is straight as far as that."""
        cycle = self._cycle
        if (target := self._targets[j]) is None:
            target = self._targets[j] = self._step(j)
            change = self._place(j, target) - cycle.about[j]
            little = change**2 <= SETTLED**2 * np.maximum(np.diag(cycle.covs[j]), 0.0)
            if little.all() or (np.abs(cycle.found.F[j] @ change) <= cycle.found.straight).all():
                self._targets[j] = None
                return None
        return self._starts[j].towards(target, float(self._shares[j]))

    def _step(self, j: int) -> _Start:
        """The most probable start by the motion as it is linearised now."""
        cycle, H = self._cycle, self._H
        found = cycle.found
        G = H @ found.F[j]
        C = self._considered * (G @ cycle.columns[j] + H @ found.added[j])
        S = G @ cycle.covs[j] @ G.T + C @ C.T + self._noise(j, found)
        w = np.linalg.solve(S, self._z - H @ found.ends[j] - G @ (cycle.means[j] - cycle.about[j]))
        return _Start(G.T @ w, C.T @ w, np.inf)

    def _judged(self, j: int, start: _Start, motion: LinearMotion) -> _Start:
        H = self._H
        off = self._z - H @ (motion.ends[j] + motion.added[j] @ start.errors)
        prior = start.dual @ self._cycle.covs[j] @ start.dual + start.errors @ start.errors
        return replace(start, cost=float(prior + off @ np.linalg.solve(self._noise(j, motion), off)))

    def _noise(self, j: int, motion: LinearMotion) -> Floats:
        """Covariance of the noise of z, that of the cycle included, (m, m)."""
        return np.asarray(measured(motion.Q[j], self._H)[1] + self._R)
