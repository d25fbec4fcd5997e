"""Interacting multiple models: filterpy's estimator with rates in place of odds a frame, and logarithmic likelihoods.

Source: [barshalom2001], section 11.6.6.
"""

from __future__ import annotations

from collections.abc import Sequence

import filterpy.kalman as filterpy
import numpy as np
from numpy.typing import NDArray

from estimators.exponential import small_expm
from estimators.unscented import UnscentedKalmanFilter

Floats = NDArray[np.float64]


class InteractingMixture(filterpy.IMMEstimator):
    """A bank of unscented filters of one state, mixed by how well each explains the measurements.

    filters: one for each mode, of equal state
    rates: how often mode i turns into mode j [1/s], (n_modes, n_modes), rows summing to zero
    mu: probability of each mode, (n_modes,)

    Differs from filterpy: the transition matrix is exp(rates dt), so that the odds do not depend on the frame rate;
    likelihoods are compared as logarithms, so that two hopeless modes are still told apart.
    """

    def __init__(self, filters: Sequence[UnscentedKalmanFilter], mu: Floats, rates: Floats) -> None:
        super().__init__(list(filters), mu, np.eye(len(filters)))
        self.rates = np.asarray(rates, dtype=float)

    def restart(self, mean: Floats, cov: Floats) -> None:
        """Give every mode the same belief: mean (dim_x,), cov (dim_x, dim_x); mode probabilities stay."""
        for f in self.filters:
            f.x, f.P = mean.copy(), cov.copy()
        self._compute_state_estimate()

    def predict(self, dt: float, longest_s: float = np.inf) -> None:
        """Mix, then move every mode ahead by dt [s], in equal steps no longer than longest_s."""
        self.M = small_expm(self.rates * dt)
        self._compute_mixing_probabilities()
        xs = np.array([f.x for f in self.filters])
        Ps = np.array([f.P for f in self.filters])
        n = max(1, int(np.ceil(dt / longest_s - 1e-9)))
        for f, w in zip(self.filters, self.omega.T, strict=True):
            f.x, f.P = mixed(w, xs, Ps)
        for f in self.filters:
            for _ in range(n):
                f.predict(dt / n)
        # filterpy moves mu only in update; between two updates the prior is the one that the rates give
        self.mu = self.cbar
        self._compute_state_estimate()

    def update_linear(self, z: Floats, H: Floats, R: Floats) -> None:
        """Take in z = H x + noise of covariance R: z (m,), H (m, dim_x), R (m, m)."""
        for f in self.filters:
            f.update_linear(z, H, R)
        logs = np.array([f.log_likelihood for f in self.filters])
        self.likelihood = np.exp(logs - logs.max())
        posterior = self.mu * self.likelihood
        self.mu = posterior / posterior.sum()
        self._compute_state_estimate()

    def _compute_state_estimate(self) -> None:
        xs = np.array([f.x for f in self.filters])
        Ps = np.array([f.P for f in self.filters])
        self.x, self.P = mixed(self.mu, xs, Ps)


def mixed(weights: Floats, means: Floats, covs: Floats) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) of a Gaussian mixture: weights (k,), means (k, n), covs (k, n, n)."""
    mean = weights @ means
    away = means - mean
    cov = np.einsum("k,kij->ij", weights, covs) + (weights[:, None] * away).T @ away
    return mean, 0.5 * (cov + cov.T)
