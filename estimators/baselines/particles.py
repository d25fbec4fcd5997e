"""Particle filter of the tissue, with enough particles to approximate the optimal filter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from dynamics import MassSpringNetwork
from estimators.arrays import Floats
from estimators.baselines.baseline import Baseline
from estimators.consistency.joseph import joseph_update
from estimators.core.disturbances import Disturbances
from estimators.core.moments import mixed
from estimators.filters.kernels import moments, symmetric_points
from estimators.filters.unscented import positive_points
from estimators.process.process_model import QUIET, ForceMode
from estimators.process.target import TargetPoint
from estimators.tissue.settings import FilterSettings

N_PARTICLES = 100
"""Number of particles. In six frames at 30 Hz, the two modes have only `2^6 = 64` possible histories."""

BRANCH_S = 1.0 / 30.0
"""Interval after which a particle is replaced by two successors, see `ParticleFilter` [s]; choice."""


class ParticleFilter(Baseline):
    """Rao-Blackwellised particle filter [doucet2000]. A particle is a history of modes.

    A short force acts in mode 1 and does not act in mode 0. For a given history, the state is nearly Gaussian. Each
    particle therefore has an unscented filter of the state. At each branch, `resample` first keeps at most n_particles
    particles [fearnhead2003]. Then two weighted successors, one for each mode, replace each particle. `Disturbances`
    gives the mean durations of the modes.

    State: means (n, dim_x), covs (n, dim_x, dim_x), modes (n,) and weights (n,) of the particles.
    """

    means: Floats
    covs: Floats
    modes: NDArray[np.int64]
    weights: Floats

    def __init__(
        self,
        network: MassSpringNetwork,
        target: str | TargetPoint,
        marked: Sequence[str],
        settings: FilterSettings | None = None,
        *,
        rng: np.random.Generator,
        n_particles: int = N_PARTICLES,
    ) -> None:
        super().__init__(network, target, marked, settings)
        if n_particles < 1:
            raise ValueError(f"n_particles: expected 1 or more, found {n_particles}")
        self._rng = rng
        self._n = n_particles
        points = positive_points(self.model.dim_x)
        self._scale = points.alpha**2 * (points.n + points.kappa)
        self._weights = points.Wm, points.Wc
        usual = Disturbances()
        self._lasting_s = np.array([usual.calm_s, usual.poked_s])
        self._rates = np.array([[-1.0, 1.0], [1.0, -1.0]]) / self._lasting_s[:, None]

    def _start(self, mean: Floats, cov: Floats) -> None:
        self.means, self.covs, self.modes = np.tile(mean, (2, 1)), np.tile(cov, (2, 1, 1)), np.arange(2)
        self.weights = self._lasting_s / self._lasting_s.sum()

    def _advance(self, dt: float) -> None:
        n = max(1, round(dt / BRANCH_S))
        for _ in range(n):
            self._branch(dt / n)

    def _branch(self, dt: float) -> None:
        """Keep at most `n_particles` particles. Then replace each particle by its successors after dt [s]."""
        self._thin()
        odds = expm(self._rates * dt)[self.modes]
        moved = [self._moved(mode, dt) for mode in (QUIET, self.settings.poked)]
        self.means, self.covs = (np.concatenate(each) for each in zip(*moved, strict=True))
        self.weights = (self.weights[:, None] * odds).T.ravel()
        self.modes = np.repeat(np.arange(2), len(odds))

    def _moved(self, mode: ForceMode, dt: float) -> tuple[Floats, Floats]:
        xs, Ps, n_steps = self.means, self.covs, self.model.stepper.n_steps(dt)
        Q = self.model.noise(dt / n_steps, mode)
        for _ in range(n_steps):
            points = np.array([symmetric_points(x, P, self._scale)[0] for x, P in zip(xs, Ps, strict=True)])
            moved = self.model.propagate_each(points, dt / n_steps, [mode] * len(xs))
            each = [moments(points, *self._weights, Q) for points in moved]
            xs, Ps = (np.array(one) for one in zip(*each, strict=True))
        return xs, Ps

    def _take(self, z: Floats, rows: NDArray[np.int64], R: Floats) -> None:
        H = np.eye(self.model.dim_x)[rows]
        logs = np.empty(len(self.weights))
        for k, (x, P) in enumerate(zip(self.means, self.covs, strict=True)):
            self.means[k], self.covs[k], _, _, _, nis, log_det, _ = joseph_update(x, P, z, H, R)
            logs[k] = -0.5 * (nis + log_det)
        weights = self.weights * np.exp(logs - logs.max())
        self.weights = weights / weights.sum()

    def _thin(self) -> None:
        kept, weights = resample(self.weights, self._n, self._rng)
        self.means, self.covs, self.modes = self.means[kept], self.covs[kept], self.modes[kept]
        self.weights = weights

    def _moments(self) -> tuple[Floats, Floats]:
        return mixed(self.weights, self.means, self.covs)

    def _poked(self) -> float:
        return float(self.weights[self.modes == 1].sum())


def resample(weights: Floats, n: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], Floats]:
    """Indices of at most n weights to keep, and their new weights, which are unbiased and have the least variance.

    A weight above a threshold c stays unchanged. A weight w below c becomes c with probability `w / c`; otherwise the
    weight is omitted. Source: [fearnhead2003].
    """
    alive = np.flatnonzero(weights > 0.0)
    if len(alive) <= n:
        return alive, weights[alive] / weights.sum()
    ordered = np.sort(weights)
    below = np.cumsum(ordered)
    # c solves sum(min(w / c, 1)) = n: if k weights are above c, the sum of the other weights is (n - k) c
    larger = np.arange(len(weights))[::-1]
    thresholds = below / np.maximum(n - larger, 1)
    upper = np.append(ordered[1:], np.inf)
    fits = (larger < n) & (thresholds < upper) & (thresholds >= ordered)
    c = float(thresholds[np.argmax(fits)])
    sure = weights >= c
    rest = np.flatnonzero(~sure)
    places = (np.cumsum(weights[rest]) / c + rng.random()) // 1.0
    drawn = rest[np.diff(places, prepend=0.0) > 0.0] if len(rest) else rest
    kept = np.concatenate([np.flatnonzero(sure), drawn])
    new = np.where(sure, weights, c)[kept]
    return kept, new / new.sum()
