"""How large the errors of three estimates of the same places are, by how far they lie apart.

Two of them err in proportion to one covariance, for they share a model; the third has one of its own, which was found
from a number of values and is known as well as these tell it. The variances of three estimates follow from the
distances between them, as those of three clocks do [gray1974]; here by maximum likelihood, with what was known as the
prior.
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

    @property
    def share_of_second(self) -> float:
        """Weight of the second beside the first in their best mean, 0 to 1."""
        return self.first / (self.first + self.second)

    @property
    def of_mean(self) -> float:
        """Factor on the covariance that the best mean of first and second has."""
        return self.first * self.second / (self.first + self.second)


def likeliest_scales(
    distances: tuple[Floats, Floats],
    cov: Floats,
    beside: Floats,
    *,
    most: float = np.inf,
    least: float = 1.0,
    known: float = 0.0,
) -> Scales:
    """Scales that best explain the distances, by Fisher's scoring on their logarithms; of at least 1 but the second.

    distances: of the first and of the second estimate from the third [m], each (k, dim)
    cov, beside: of the errors of first and second, and of the third [m²], (k, dim, dim); most: the first's scale is no
        larger; least: the second's no smaller; known: information on the logarithm of the third's, 1, before any
        distance: half the number of coordinates that its covariance was found from
    """
    apart = np.concatenate(distances, axis=1)
    none = np.zeros_like(cov)
    first, second, third = _blocks(cov, none), _blocks(none, cov), np.tile(beside, (1, 2, 2))
    lowest, highest = np.array([1.0, least, 1.0]), np.array([most, np.inf, np.inf])
    scales, prior = np.clip(np.array(FIRST), lowest, highest), np.array([0.0, 0.0, known])
    for _ in range(PASSES):
        parts = np.stack([scales[0] * first, scales[1] * second, scales[2] * third])
        inverse = np.linalg.inv(parts.sum(axis=0))
        weighed, shares = (inverse @ apart[:, :, None])[..., 0], inverse @ parts
        # score and information of the logarithms of the scales
        score = 0.5 * (np.einsum("ki,pkij,kj->p", weighed, parts, weighed) - np.einsum("pkii->p", shares))
        information = 0.5 * np.einsum("pkij,qkji->pq", shares, shares)
        # where the prior holds a scale back, distances beyond it curve the posterior, too: else steps overshoot
        information += np.diag(prior + np.maximum(score, 0.0) + ROUNDING * apart.size)
        score -= prior * np.log(scales)
        held = ((scales <= lowest) & (score < 0.0)) | ((scales >= highest) & (score > 0.0))
        moved = np.flatnonzero(~held)
        step = np.zeros(3)
        step[moved] = np.clip(np.linalg.solve(information[np.ix_(moved, moved)], score[moved]), -1.0, 1.0)
        scales = np.clip(scales * np.exp(step), lowest, highest)
        if np.abs(step).max() < ROUNDING:
            break
    return Scales(*(float(each) for each in scales))


def _blocks(first: Floats, second: Floats) -> Floats:
    """Block-diagonal matrices (k, 2 n, 2 n) of blocks (k, n, n)."""
    none = np.zeros_like(first)
    return np.concatenate([np.concatenate([first, none], axis=2), np.concatenate([none, second], axis=2)], axis=1)
