"""Innovations of the hypotheses, and detection of outliers among the observations."""

from __future__ import annotations

import operator
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dtrtri

from estimators.arrays import Floats
from estimators.core.kernels import without_outliers
from estimators.core.moments import mixed, of_each
from estimators.core.protocols import Observation
from estimators.filters.unscented import CovarianceError

FAR = 1e4
"""Variance that `far_m2` assigns to an outlier, relative to the square of `Outliers.reach_m` [1]; numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """Innovation of each of k hypotheses: observation minus prediction.

    Attributes
    ----------
    y, S : (k, m), (k, m, m)
        Innovation and its covariance.
    H, HP : (1, m, n) or (k, m, n), (k, m, n)
        Jacobian H of the observation, and product of H with the state's covariance. Equal Jacobians are stored once.
    root, white : (k, m, m), (k, m)
        Inverse of the lower Cholesky factor of S, and product of this inverse with the innovation.
    nis, logs : (k,)
        Normalised innovation squared, and log of the hypothesis' weight after the update, up to a constant.
    outlying : (k, n_names) bool
        Whether each named mark is an outlier. An outlier has innovation 0 and a large variance.
    overall : (m,), (m, m)
        Mean and covariance of the innovation over all hypotheses, before outliers are removed.
    """

    y: Floats
    S: Floats
    H: Floats
    HP: Floats
    root: Floats
    white: Floats
    nis: Floats
    logs: Floats
    outlying: NDArray[np.bool_]
    overall: tuple[Floats, Floats]


def joined(parts: Sequence[Floats]) -> Floats:
    """Concatenate vectors, or the rows of matrices."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def block_diagonal(blocks: Sequence[Floats]) -> Floats:
    """Block-diagonal matrix of square blocks; SciPy's function takes ten times as long."""
    ends = np.cumsum([len(block) for block in blocks])
    found = np.zeros((ends[-1], ends[-1]))
    for block, end in zip(blocks, ends, strict=True):
        found[end - len(block) : end, end - len(block) : end] = block
    return found


def together(observations: Sequence[Observation]) -> tuple[Floats, Floats]:
    """Concatenated values of all observations, (m,), and the covariance of their errors, (m, m)."""
    if len(observations) == 1:
        return observations[0].value, observations[0].cov
    return joined([one.value for one in observations]), block_diagonal([one.cov for one in observations])


def named(observations: Sequence[Observation]) -> tuple[list[str], list[slice]]:
    """Names of all blocks, and rows of each block in the concatenated values of all observations."""
    names: list[str] = []
    blocks: list[slice] = []
    start = 0
    for one in observations:
        names += one.names
        blocks += [slice(block.start + start, block.stop + start) for block in one.blocks]
        start += len(one.value)
    return names, blocks


def are_same(some: Sequence[object], others: Sequence[object]) -> bool:
    """Whether two sequences contain the same objects in the same order."""
    return len(some) == len(others) and all(map(operator.is_, some, others))


def inverse_roots(S: Floats) -> Floats:
    """Inverse of the lower Cholesky factor of each innovation covariance, (k, m, m); raises CovarianceError."""
    roots = np.empty_like(S)
    for own, root in zip(S, roots, strict=True):
        factor, failed = dpotrf(own.T)  # the transpose of a C array is a Fortran array: nothing is copied
        if failed:
            raise CovarianceError("innovation covariance: expected a positive definite matrix, found another")
        root[:] = dtrtri(factor, overwrite_c=True)[0].T
    return roots


def each_alone(names: Sequence[str], blocks: Sequence[slice]) -> Sequence[NDArray[np.int64]]:
    """For each block, a group without other blocks: an array (1, k) with the indices of the block's k rows."""
    return [np.arange(block.start, block.stop)[None] for block in blocks]


@dataclass(frozen=True, slots=True)
class Outliers:
    """Prior of outliers, whose positions are uniformly distributed over a region.

    Attributes
    ----------
    names : collection of str
        Names of the marks that may be outliers.
    odds : float
        Prior odds that a mark is an outlier [1].
    reach_m : float
        Extent of the region in each coordinate [m].
    """

    names: Collection[str]
    odds: float
    reach_m: float

    def log_densities(self, names: Sequence[str], blocks: Sequence[slice]) -> Floats:
        """Log of `prior odds * outlier density` of each block, (n_blocks,); -inf if the mark cannot be an outlier."""
        own = [
            np.log(self.odds) - (block.stop - block.start) * np.log(self.reach_m) if name in self.names else -np.inf
            for name, block in zip(names, blocks, strict=True)
        ]
        return np.array(own)

    @property
    def far_m2(self) -> float:
        """Variance that replaces the innovation variance of an outlier [m²]."""
        return FAR * self.reach_m**2


def solved(
    found: tuple[Floats, ...], weights: Floats, observations: Sequence[Observation], outliers: Outliers | None
) -> Innovations:
    """Innovations after the removal of outliers. Raises CovarianceError.

    found: y, S, H, HP of `Innovations` before the removal; weights: weights of the hypotheses before the update, (k,)
    """
    y, S, H, HP = found
    overall = mixed(weights, y, S)
    with np.errstate(divide="ignore"):  # an omitted hypothesis stays omitted until the next prediction
        logs, outlying = np.log(weights), np.zeros((len(y), 0), dtype=bool)
    root = inverse_roots(S)
    white = of_each(root, y)
    if not np.isfinite(white).all():
        raise CovarianceError("innovation: expected finite, found otherwise")
    if outliers is not None:
        names, blocks = named(observations)
        ends, densities = np.array([block.stop for block in blocks]), outliers.log_densities(names, blocks)
        outlying, added = without_outliers(y, S, root, ends, densities, outliers.far_m2)
        own = np.flatnonzero(outlying.any(axis=1))
        if len(own):
            logs += added
            root[own] = inverse_roots(S[own])
            white[own] = of_each(root[own], y[own])
            # outliers contain no information about the state
            HP[np.repeat(outlying, [block.stop - block.start for block in blocks], axis=1)] = 0.0
    nis = (white * white).sum(axis=1)
    logs += np.log(root.diagonal(0, 1, 2)).sum(axis=1) - 0.5 * nis
    return Innovations(y, S, H, HP, root, white, nis, logs, outlying, overall)
