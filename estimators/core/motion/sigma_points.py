"""Statistical linearisation by sigma points: the unscented way to move a Gaussian through a process model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from estimators.arrays import Floats
from estimators.core.protocols import Transition


def by_sigma_points(
    tangent: Transition, mean: Floats, cov: Floats, m: int, moved: Callable[[Floats], Floats]
) -> Transition:
    """A transition of which the first m states are linear in themselves by regression over sigma points.

    The mean moves as the tangent says, and further by as much as the mean of the points differs from where the mean
    itself goes. Points lie sqrt(m) columns of the root of the covariance on both sides of the mean: the
    unscented transform with kappa = 0, whose point at the mean has no weight. What the regression leaves over is noise.
    Source: [julier1997], [garciafernandez2017].

    Parameters
    ----------
    tangent : Transition
        By its derivative: what depends on other states, and the noise.
    mean, cov : (n,), (n, n)
        Of the state before.
    m : int
        States, the first, in which the motion is not linear.
    moved : callable
        The first m states that follow, (k, m), from states (k, n); forces may be simplified, alike in all.
    """
    root = np.linalg.cholesky(cov[:m, :m])
    steps = np.sqrt(m) * root.T
    points = np.tile(mean, (2 * m + 1, 1))
    points[:m, :m] += steps
    points[m:-1, :m] -= steps
    found = moved(points)
    ends, middle = found[:-1], found[-1]
    centre = ends.mean(axis=0)
    by_step = (ends[:m] - ends[m:]) / (2.0 * np.sqrt(m))  # of a point one standard deviation off, (m, m)
    matrix = tangent.matrix.copy()
    matrix[:m, :m] = np.linalg.solve(root.T, by_step).T
    even = ends[:m] + ends[m:] - 2.0 * centre  # what is alike on both sides is not linear
    spread = even.T @ even / (4.0 * m)
    end = tangent.mean.copy()
    end[:m] += centre - middle
    return replace(tangent, mean=end, matrix=matrix, spread=spread)
