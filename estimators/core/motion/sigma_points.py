"""Statistical linearisation with sigma points: the unscented prediction of a Gaussian by a process model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from estimators.arrays import Floats
from estimators.core.protocols import Transition


def by_sigma_points(
    tangent: Transition, mean: Floats, cov: Floats, m: int, moved: Callable[[Floats], Floats]
) -> Transition:
    """Replace the linearisation of the first m states by a regression over sigma points.

    The sigma points are those of the unscented transform with kappa = 0: `mean ± sqrt(m) c` for each column c of the
    covariance's Cholesky factor. Residuals become process noise. Source: [julier1997], [garciafernandez2017].

    Parameters
    ----------
    tangent : Transition
        Linearisation by derivatives. It remains in use for the other states and for the noise.
    mean, cov : (n,), (n, n)
        Moments of the previous state.
    m : int
        Number of states with nonlinear motion. They are the first states.
    moved : callable
        Returns the first m states after the step, (k, m), from k states (k, n).
    """
    root = np.linalg.cholesky(cov[:m, :m])
    steps = np.sqrt(m) * root.T
    points = np.tile(mean, (2 * m + 1, 1))
    points[:m, :m] += steps
    points[m:-1, :m] -= steps
    found = moved(points)
    ends, middle = found[:-1], found[-1]
    centre = ends.mean(axis=0)
    by_step = (ends[:m] - ends[m:]) / (2.0 * np.sqrt(m))  # for one standard deviation, (m, m)
    matrix = tangent.matrix.copy()
    matrix[:m, :m] = np.linalg.solve(root.T, by_step).T
    even = ends[:m] + ends[m:] - 2.0 * centre  # the even part is nonlinear
    spread = even.T @ even / (4.0 * m)
    end = tangent.mean.copy()
    end[:m] += centre - middle
    return replace(tangent, mean=end, matrix=matrix, spread=spread)
