"""A smooth field through noisy values: Gaussian-process interpolation with a linear trend.

The values are a trend, linear in given functions of the place and of unknown slopes, and a stationary field about it.
Its variance is found by cross-validation from the values alone, so that nothing is assumed of it but how far it is
smooth. Source: [rasmussen2006], 2.7 for the trend, 5.4.2 for leaving one out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats

SETTLED = 0.05
"""Change of the field's variance from pass to pass that ends the search for it [1]; numerical: of 20 values it is known
to a third."""

PASSES = 20
"""Passes of that search, at most; numerical."""

EXACT = 1e-9
"""Variance of the noise of an exact value, and least variance of the field, by the other [1]; numerical."""


def matern(distances: Floats) -> Floats:
    """Correlation at these distances, by the length over which it falls: a field with two derivatives, Matern's 5/2."""
    scaled = np.sqrt(5.0) * distances
    return np.asarray((1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled))


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """The field's places, before any value.

    correlation: between all places, (n, n); trend: functions of the place that the values may follow, (n, q)
    """

    correlation: Floats
    trend: Floats

    def through(self, places: list[int], values: Floats, variances: Floats) -> tuple[Floats, Floats] | None:
        """Mean of the field, (n, d), and covariance of each of its d components, (n, n), given values at k places.

        values (k, d), variances of their noise (k,), 0 where they are exact. None where they leave nothing beyond the
        trend to tell how large the field is: k must exceed the q functions of the trend by two, and tell them apart.
        """
        k, q = len(places), self.trend.shape[1]
        K, F = self.correlation[np.ix_(places, places)], self.trend[places]
        if k < q + 2 or np.linalg.matrix_rank(F) < q:
            return None
        noisy = variances > 0.0
        variance = max(float(np.var(values, axis=0).mean()), EXACT * float(variances.max(initial=1.0)))
        least = EXACT * variance + 1e-3 * float(variances.mean())
        for _ in range(PASSES):
            system = np.zeros((k + q, k + q))
            system[:k, :k] = K + np.diag(np.maximum(variances / variance, EXACT))
            system[:k, k:], system[k:, :k] = F, F.T
            solved = np.linalg.inv(system)
            precision = solved[:k, :k]
            diagonal = np.diag(precision)[:, None]
            # Equation (5.12): the value that is left out, less the mean by the others, is (P y)_i / P_ii, its variance
            # 1 / P_ii
            left_out = (precision @ values)[noisy] ** 2 / diagonal[noisy]
            before, variance = variance, max(float(left_out.mean()), least)
            if abs(variance - before) <= SETTLED * before:
                break
        ahead = np.vstack([self.correlation[places], self.trend.T])
        weights = solved @ ahead
        cov = variance * (self.correlation - ahead.T @ weights)
        return weights[:k].T @ values, 0.5 * (cov + cov.T)
