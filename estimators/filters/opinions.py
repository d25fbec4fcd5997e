"""How large the errors of three estimates of the same places are, by how far they lie apart.

Two of them err in proportion to one covariance, for they share a model, and their errors are correlated; the third
errs by other causes. The variances of three estimates follow from the distances between them, as those of three clocks
do [gray1974]; here by maximum likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats

PASSES = 15
"""Steps of Fisher's scoring to the likeliest scales, at most; numerical."""

FIRST = (1.0, 1.0, 4.0)
"""Scales that the search begins with; numerical."""

ROUNDING = 1e-3
"""Information that is added to that of a scale which the distances do not tell [1]; numerical."""


@dataclass(frozen=True, slots=True)
class Scales:
    """Factors on the covariances of the errors of three estimates [1].

    first, second: on that which the two with a model in common have; third: on that of the third
    """

    first: float = 1.0
    second: float = 1.0
    third: float = 1.0

    def remembered(self, before: Scales, share: float) -> Scales:
        """These by a share, what was before by the rest; factors without a bound by their logarithms."""
        kept = 1.0 - share
        return Scales(
            kept * before.first + share * self.first,
            before.second**kept * self.second**share,
            before.third**kept * self.third**share,
        )

    def share_of_second(self, correlation: float) -> float:
        """Weight of the second beside the first in their best mean, 0 to 1."""
        common = correlation * np.sqrt(self.first * self.second)
        return float(np.clip((self.first - common) / (self.first + self.second - 2.0 * common), 0.0, 1.0))

    def of_mean(self, share: float, correlation: float) -> float:
        """Factor on the covariance that the mean of first and second has, the second by this share."""
        common = correlation * np.sqrt(self.first * self.second)
        kept = 1.0 - share
        return float(kept**2 * self.first + share**2 * self.second + 2.0 * share * kept * common)


def likeliest_scales(
    distances: tuple[Floats, Floats], cov: Floats, beside: Floats, *, most: float, correlation: float
) -> Scales:
    """Scales of at least 1 that best explain the distances, by Fisher's scoring on their logarithms.

    distances: of the first and of the second estimate from the third [m], each (k, dim)
    cov, beside: of the errors of first and second, and of the third [m²], (k, dim, dim); most: the first's scale is no
        larger; correlation: of the errors of first and second
    """
    apart = np.concatenate(distances, axis=1)
    none = np.zeros_like(cov)
    first, second = _blocks(cov, none, none), _blocks(none, none, cov)
    both, third = _blocks(none, cov, none), _blocks(beside, beside, beside)
    least, largest = np.ones(3), np.array([most, np.inf, np.inf])
    scales = np.minimum(np.array(FIRST), largest)
    for _ in range(PASSES):
        common = 0.5 * correlation * np.sqrt(scales[0] * scales[1]) * both
        parts = np.stack([scales[0] * first + common, scales[1] * second + common, scales[2] * third])
        inverse = np.linalg.inv(parts.sum(axis=0))
        weighed, shares = (inverse @ apart[:, :, None])[..., 0], inverse @ parts
        # score and information of the logarithms of the scales
        score = 0.5 * (np.einsum("ki,pkij,kj->p", weighed, parts, weighed) - np.einsum("pkii->p", shares))
        information = 0.5 * np.einsum("pkij,qkji->pq", shares, shares) + ROUNDING * apart.size * np.eye(3)
        held = ((scales <= least) & (score < 0.0)) | ((scales >= largest) & (score > 0.0))
        moved = np.flatnonzero(~held)
        step = np.zeros(3)
        step[moved] = np.clip(np.linalg.solve(information[np.ix_(moved, moved)], score[moved]), -1.0, 1.0)
        scales = np.clip(scales * np.exp(step), least, largest)
        if np.abs(step).max() < ROUNDING:
            break
    return Scales(*(float(each) for each in scales))


def _blocks(own: Floats, across: Floats, other: Floats) -> Floats:
    """Symmetric matrices (k, 2 n, 2 n) of blocks (k, n, n)."""
    return np.concatenate([np.concatenate([own, across], axis=2), np.concatenate([across, other], axis=2)], axis=1)
