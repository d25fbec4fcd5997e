"""Moments of several hypotheses at once: mixed, moved, mapped."""

from __future__ import annotations

import numpy as np

from estimators.arrays import Floats
from estimators.core.protocols import Transition

AT_A_TIME = 2**15
"""Entries of covariances that stay in the cache; numerical."""


def mixed(weights: Floats, means: Floats, covs: Floats) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) of a mixture of Gaussians, (k,), (k, n), (k, n, n)."""
    mean = weights @ means
    apart = means - mean
    return mean, np.tensordot(weights, covs, 1) + (apart.T * weights) @ apart


def several(covs: Floats) -> list[slice]:
    """Slices of so many covariances (k, n, n) as are worked on at a time."""
    step = max(1, AT_A_TIME // covs[0].size)
    return [slice(k, k + step) for k in range(0, len(covs), step)]


def propagated(before: Floats, transition: Transition, variances: Floats, after: Floats) -> None:
    """Write T P T' and the noise of sources of variances (k, n_sources) into `after`, for each P before, (k, n, n).

    Last states that only fade, each by itself, are not multiplied out, nor are last columns of zeros in the others.
    """
    T, (n_noises, m, _) = transition.matrix, transition.noises.shape
    noises, fading = transition.noises.reshape(n_noises, m * m), T.diagonal()
    acting = T != 0.0
    np.fill_diagonal(acting, False)
    r = int(np.flatnonzero(acting.any(axis=1)).max(initial=-1)) + 1
    c = max(r, int(np.flatnonzero(acting.any(axis=0)).max(initial=-1)) + 1)
    rows, fading, faded = T[:r, :c], fading[r:], np.outer(fading[r:], fading[r:])
    for some in several(before):
        P, moved = before[some], after[some]
        half = rows @ P[:, :c]
        corner = 0.5 * (half[:, :, :c] @ rows.T)
        np.add(corner, corner.swapaxes(1, 2), out=moved[:, :r, :r])
        np.multiply(half[:, :, r:], fading, out=moved[:, :r, r:])
        moved[:, r:, :r] = moved[:, :r, r:].swapaxes(1, 2)
        np.multiply(P[:, r:, r:], faded, out=moved[:, r:, r:])
        moved[:, :m, :m] += (variances[some, :n_noises] @ noises).reshape(-1, m, m)
        if transition.spread is not None:
            moved[:, : len(transition.spread), : len(transition.spread)] += transition.spread
    if len(transition.independent):
        np.einsum("kii->ki", after)[:] += variances[:, n_noises:] @ transition.independent


def of_each(matrices: Floats, vectors: Floats) -> Floats:
    """Each matrix (k, m, n), or the one, times each vector (k, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
