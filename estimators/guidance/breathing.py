"""Model of a breathing target: fits period and phase to a filter's estimates, and predicts the target's path.

The past estimates are called the track. For each period of a grid, a constant and some harmonics are fitted to the
track by least squares with exponential forgetting. Each period is weighted by its likelihood, `exp(-misfit / 2)`. The
prediction is the mixture over all periods. Errors of neighbouring frames are correlated. The misfit is therefore
multiplied by the number of independent errors per frame, which is usually below 1.

After a shift, a cough or a pause of breathing, the model may be wrong. Therefore each estimate is compared with the
model's prediction before it is added to the track. The alternative to the model is that the target's distance from the
prediction is a random walk. Bayes' rule, with a constant hazard of change, gives the probability that the model is
right. If this probability is small, a new track begins [adams2007].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit

from estimators.arrays import Floats

RIDGE = 1e-3
"""Number added to the diagonal of the information matrix, so that one frame is enough for a fit; numerical: at most
0.001 of the information of one frame. Half or twice this value changes all results of guidance by less than 0.2 %."""


@dataclass(frozen=True, slots=True)
class BreathingSettings:
    """Settings of the breathing model.

    shortest_s, longest_s: shortest and longest period of the grid [s], for 21 and 9 breaths per minute; choice
    n_periods: number of periods in the grid, evenly spaced in frequency; choice
    harmonics: number of harmonics of each period; choice
    memory_s: time constant of the exponential forgetting [s]; choice
    alike_s: time after which a new error of the filter is independent of an old error [s]; choice
    cycles: a breath is reported if the past estimates cover at least this number of its periods; choice
    explained: a breath is reported if its fit explains at least this share of the estimates' variance; choice
    lasting_s: mean time for which a target moves as the model predicts [s]; choice
    forgotten: if the probability that the model holds is below this, all past estimates are discarded; choice
    """

    shortest_s: float = 2.8
    longest_s: float = 6.5
    n_periods: int = 80
    harmonics: int = 3
    memory_s: float = 15.0
    alike_s: float = 0.2
    cycles: float = 1.5
    explained: float = 0.9
    lasting_s: float = 100.0
    forgotten: float = 0.01

    def __post_init__(self) -> None:
        if not 0.0 < self.shortest_s < self.longest_s < np.inf:
            raise ValueError(
                f"breathing: expected 0 < shortest_s < longest_s, found {self.shortest_s}, {self.longest_s}"
            )
        for name in ("lasting_s", "forgotten"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"breathing {name}: expected more than 0, found {getattr(self, name)}")
        if self.n_periods < 2 or self.harmonics < 1:
            raise ValueError(
                f"breathing: expected 2 periods, 1 harmonic or more, found {self.n_periods}, {self.harmonics}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Breath:
    """Breath fitted to past estimates.

    period_s, period_sd_s: mean and standard deviation of the period [s]
    scatter_m: standard deviation of the target about the fit [m]; weights: probability of each period, (n_periods,)
    explained: share of the estimates' variance that the fit explains
    """

    period_s: float
    period_sd_s: float
    scatter_m: float
    explained: float
    weights: Floats


class Breathing:
    """Predictor of a breathing target, updated frame by frame with a filter's estimates.

    State: sums over past estimates with exponential forgetting; times of first and last estimate; last fit; probability
    that the model holds; vector from the model's prediction to the target [m], (dim,), and its covariance.
    """

    def __init__(self, dim: int, settings: BreathingSettings | None = None) -> None:
        self.settings = BreathingSettings() if settings is None else settings
        s = self.settings
        self.periods_s = 1.0 / np.linspace(1.0 / s.longest_s, 1.0 / s.shortest_s, s.n_periods)
        self.dim = dim
        self._last_s = -np.inf
        self._begin()

    def _begin(self) -> None:
        """Discard all past estimates."""
        s = self.settings
        n = 2 * s.harmonics + 1
        self._first_s = np.inf
        self._origin: Floats
        self._information = np.zeros((s.n_periods, n, n))
        self._products = np.zeros((s.n_periods, n, self.dim))
        self._filter_variance = 0.0
        self._squares, self._weight, self._sum = 0.0, 0.0, np.zeros(self.dim)
        self._fit: tuple[Floats, Floats, Breath] | None = None
        self._holds = 1.0
        self._walk, self._walk_cov = np.zeros(self.dim), np.zeros((self.dim, self.dim))

    def update(self, time_s: float, mean: Floats, cov: Floats) -> None:
        """Add a filter's estimate of the target at a time [s]: its mean [m], (dim,), and covariance [m²], (dim, dim).

        Raises ValueError if the time does not increase, if the dimension differs, or if a number is not finite.
        """
        if not (self._last_s < time_s < np.inf):
            raise ValueError(f"time_s: expected more than {self._last_s}, found {time_s}")
        if np.shape(mean) != (self.dim,) or not np.isfinite(mean).all():
            raise ValueError(f"mean: expected {self.dim} finite coordinates, found {mean}")
        if (breath := self.breath()) is not None:
            self._compare(breath, time_s, mean, cov)
        if not self._weight:
            self._first_s = self._last_s = time_s
            self._origin = np.array(mean, dtype=float)
        keep = np.exp(-(time_s - self._last_s) / self.settings.memory_s)
        x, phi = np.asarray(mean) - self._origin, self._waves(time_s)
        self._information = keep * self._information + phi[:, :, None] * phi[:, None, :]
        self._products = keep * self._products + phi[:, :, None] * x
        self._squares = keep * self._squares + float(x @ x)
        self._weight, self._sum = keep * self._weight + 1.0, keep * self._sum + x
        self._filter_variance = keep * self._filter_variance + float(np.trace(cov)) / self.dim
        self._last_s, self._fit = time_s, None

    def breath(self) -> Breath | None:
        """The breath fitted to past estimates; None if they cover too few periods or are not periodic."""
        s = self.settings
        span = self._last_s - self._first_s
        if span < s.cycles * s.shortest_s:
            return None
        _, _, breath = self._fitted()
        seen = span >= s.cycles * breath.period_s
        return breath if seen and breath.explained >= s.explained else None

    def predict(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Means [m] (k, dim) and covariances [m²] (k, dim, dim) of the target at times [s], (k,).

        Raises ValueError if `breath` returns None.
        """
        if self.breath() is None:
            raise ValueError("predict: expected a track with a breath, found none")
        found, coefficient_covs, breath = self._fitted()
        times = np.asarray(times_s, dtype=float)
        angle = 2.0 * np.pi * times / self.periods_s[:, None]
        phi = self._of_angle(angle)
        each = phi @ found
        means = np.einsum("p,pkd->kd", breath.weights, each)
        away = each - means
        covs = np.einsum("p,pkd,pke->kde", breath.weights, away, away)
        of_fit = np.einsum("p,pkn,pnm,pkm->k", breath.weights, phi, coefficient_covs, phi)
        covs += (breath.scatter_m**2 + of_fit)[:, None, None] * np.eye(self.dim)
        return means + self._origin, covs

    def holds(self, times_s: Floats) -> Floats:
        """Probability that the model still holds at later times [s], (k,); 0 if `breath` returns None."""
        if self.breath() is None:
            return np.zeros(len(times_s))
        return self._holds * np.exp((self._last_s - np.asarray(times_s, dtype=float)) / self.settings.lasting_s)

    def _compare(self, breath: Breath, time_s: float, mean: Floats, cov: Floats) -> None:
        """Update the probability that the model holds, and the vector from the model's prediction to the target.

        A Kalman filter tracks this vector, a random walk. In one period, the variance of the walk grows by the variance
        of the past estimates. All estimates within `alike_s` count as one independent estimate.
        """
        s = self.settings
        dt = time_s - self._last_s
        counted = min(dt / s.alike_s, 1.0)
        expected, spread = self.predict(np.array([time_s]))
        error_cov = spread[0] + cov
        off = np.asarray(mean) - expected[0]
        variance = (self._squares - float(self._sum @ self._sum) / self._weight) / self._weight / self.dim
        walk_cov = self._walk_cov + variance * dt / breath.period_s * np.eye(self.dim)
        gain = np.linalg.solve(walk_cov + error_cov / counted, walk_cov).T
        for_breath = _log_density(off, error_cov) - _log_density(off - self._walk, walk_cov + error_cov)
        self._holds = float(expit(logit(self._holds * np.exp(-dt / s.lasting_s)) + counted * for_breath))
        self._walk = self._walk + gain @ (off - self._walk)
        self._walk_cov = walk_cov - gain @ walk_cov
        if self._holds < s.forgotten:
            self._begin()

    def _waves(self, time_s: float) -> Floats:
        return self._of_angle(2.0 * np.pi * time_s / self.periods_s)

    def _of_angle(self, angle: Floats) -> Floats:
        turns = angle[..., None] * np.arange(1, self.settings.harmonics + 1)
        return np.concatenate([np.ones((*angle.shape, 1)), np.cos(turns), np.sin(turns)], axis=-1)

    def _fitted(self) -> tuple[Floats, Floats, Breath]:
        """All fits: coefficients [m], (n_periods, n, dim), covariances [m²], (n_periods, n, n); and the breath."""
        if self._fit is None:
            n = self._information.shape[1]
            inverse = np.linalg.inv(self._information + RIDGE * np.eye(n))
            found = inverse @ self._products
            misfit = np.maximum(self._squares - np.einsum("pnd,pnd->p", found, self._products), 0.0)
            filled = self.settings.memory_s * -np.expm1((self._first_s - self._last_s) / self.settings.memory_s)
            independent = max(filled / self.settings.alike_s, n + 1.0)
            least = max(float(misfit.min()), 1e-18)
            scatter2 = least / self._weight / self.dim * independent / (independent - n)
            likely = -0.5 * misfit / self._weight * independent / scatter2
            weights = np.exp(likely - likely.max())
            weights /= weights.sum()
            period = float(weights @ self.periods_s)
            period_sd = float(np.sqrt(weights @ (self.periods_s - period) ** 2))
            total = self._squares - float(self._sum @ self._sum) / self._weight
            own = max(scatter2 - self._filter_variance / self._weight, 0.0)
            breath = Breath(period, period_sd, float(np.sqrt(own)), 1.0 - least / max(total, 1e-18), weights)
            # the coefficients' covariance includes the filter's errors; the scatter of the target excludes them
            self._fit = found, inverse * (scatter2 * self._weight / independent), breath
        return self._fit


def _log_density(off: Floats, cov: Floats) -> float:
    """Log density at `off` of a Gaussian with mean 0, up to a constant."""
    return -0.5 * float(off @ np.linalg.solve(cov, off) + np.linalg.slogdet(cov)[1])
