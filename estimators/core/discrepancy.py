"""Discrepancy: random field of displacements that the model does not explain; estimate of its standard deviation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork
from dynamics.elements import matern
from estimators.arrays import Floats
from estimators.core.innovations import inverse_roots
from estimators.core.kernels import withheld_log_likelihoods
from estimators.process.target import TargetPoint
from estimators.tissue.settings import FilterSettings

SOLID_LEVELS, SOLID_LEAST = (0.005, 0.015, 0.05), 5e-3
"""`Discrepancy.levels` and `Discrepancy.least` for a continuum, whose strains are small [1]; choice."""

JITTER = 1e-6
"""Variance added at fixed places, relative to the field's variance [1]; numerical."""


def factor(cov: Floats, rank: int, least: float = 1e-3) -> Floats:
    """Columns L (n, r), with r at most `rank`, such that L L' approximates a covariance (n, n).

    least: smallest variance of a column, relative to the largest variance
    """
    values, vectors = np.linalg.eigh(cov)
    kept = np.flatnonzero(values > least * values[-1])[::-1][:rank]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


@dataclass(frozen=True, slots=True)
class Discrepancy:
    """Prior of the discrepancy: sum of a field with long and a field with short correlation length; 0 at fixed nodes.

    Attributes
    ----------
    levels : tuple of float
        Possible standard deviations of the long field, relative to the body's extent [1]; choice. Their prior
        probabilities are equal.
    noises : tuple of (float, float)
        Possible factors on the stated standard deviation of marks, at least 1, with prior probabilities [1]; choice.
    short : float
        Standard deviation of the short field, relative to the long field's [1]; choice.
    lengths : tuple of float
        Correlation lengths of the two fields, relative to the body's extent [1]; choice.
    lasting_s : float
        Correlation time of the discrepancy [s]; choice.
    memory_s : float
        Time constant with which the evidence for a level is forgotten [s]; choice.
    weight : float
        Weight of the evidence of one frame [1]; choice. A weight below 1 allows for correlated frames.
    rank : int
        Largest number of basis functions of the field for each axis; numerical.
    least : float
        Smallest variance of a basis function, relative to the largest [1]; numerical.
    """

    levels: tuple[float, ...] = (0.003, 0.01, 0.03)
    noises: tuple[tuple[float, float], ...] = ((1.0, 0.99), (3.0, 0.01))
    short: float = 0.33
    lengths: tuple[float, float] = (1.5, 0.25)
    lasting_s: float = 0.3
    memory_s: float = 20.0
    weight: float = 1.0
    rank: int = 40
    least: float = 1e-3

    @classmethod
    def of(cls, settings: FilterSettings, *, solid: bool = False) -> Discrepancy:
        """Make the prior, with only the settings' level if they state one; solid: whether the body is a continuum."""
        prior = cls(levels=SOLID_LEVELS, least=SOLID_LEAST) if solid else cls()
        return prior if settings.discrepancy is None else replace(prior, levels=(settings.discrepancy,))

    def field(self, places: Floats, held: Floats) -> tuple[Floats, Floats]:
        """Basis functions [m], (n, r), at places (n, dim), for level 1, and the variance that they omit [m²], (n,)."""
        everything = np.vstack([places, held])
        extent = float(np.linalg.norm(np.ptp(everything, axis=0)))
        apart = np.linalg.norm(everything[:, None] - everything, axis=2)
        cov = sum(
            scale**2 * matern(apart, length * extent)
            for scale, length in zip((1.0, self.short), self.lengths, strict=True)
        )
        n = len(places)
        own = np.asarray(cov)[:n, :n]
        if len(held):
            fixed = cov[n:, n:] + JITTER * np.eye(len(held))  # type: ignore[index]
            own = own - cov[:n, n:] @ np.linalg.solve(fixed, cov[n:, :n])  # type: ignore[index]
        found = factor(own, self.rank, self.least)
        return extent * found, extent**2 * np.maximum(own.diagonal() - (found**2).sum(axis=1), 0.0)


class LevelPosterior:
    """Posterior of the discrepancy's level and of the factor on the marks' noise.

    Each mark is predicted from other marks, as the target is. The joint likelihood of all marks is not used: it hardly
    depends on such predictions, and favours levels that are too small.

    State: log_weights, log probability of each pair of level and noise factor, (n,); log_withheld, sum of the log
    likelihoods of the last frame's marks, each given the marks outside its group (`WithheldGroups`).
    """

    def __init__(self, prior: Discrepancy) -> None:
        noises, odds = np.array(prior.noises).T
        self.prior, self.levels = prior, np.repeat(prior.levels, len(noises))
        self.noises = np.tile(noises, len(prior.levels))
        self.log_prior = np.log(np.tile(odds / odds.sum(), len(prior.levels)) / len(prior.levels))
        self.log_weights = self.log_prior.copy()
        self.log_withheld = 0.0

    @property
    def level(self) -> float:
        """Root mean square of the level under the posterior [1]."""
        return self._rms(self.levels)

    @property
    def noise(self) -> float:
        """Root mean square, under the posterior, of the factor on the marks' stated standard deviation [1]."""
        return self._rms(self.noises)

    def _rms(self, values: Floats) -> float:
        weights = np.exp(self.log_weights - self.log_weights.max())
        return float(np.sqrt(weights @ values**2 / weights.sum()))

    def forget(self, dt: float) -> None:
        """Reduce the weight of the earlier evidence after a time step dt [s]."""
        kept = np.exp(-dt / self.prior.memory_s)
        self.log_weights = kept * self.log_weights + (1.0 - kept) * self.log_prior

    def update(
        self, innovation: Floats, S: Floats, fresh: Floats, R: Floats, groups: Sequence[NDArray[np.int64]]
    ) -> None:
        """Update the probabilities of levels and noise factors with the marks of a frame.

        Parameters
        ----------
        innovation, S : (m,), (m, m)
            Innovation of all observations and its covariance, at the present level and noise factor.
        fresh, R : (m, m)
            Covariance of the part of the discrepancy that is new in this frame, at level 1. Covariance of the marks'
            own noise, at the present noise factor.
        groups : sequence of (k, dim) int
            One group for each mark, as `WithheldGroups` returns it. Without groups nothing changes.
        """
        self.log_withheld = 0.0
        if not groups:
            return
        other, noisier = self.levels**2 - self.level**2, (self.noises / self.noise) ** 2 - 1.0
        covs = S + other[:, None, None] * fresh + noisier[:, None, None] * R
        rows = np.concatenate([group.ravel() for group in groups])
        ends, own = np.cumsum([group.size for group in groups]), np.array([group.shape[1] for group in groups])
        found = withheld_log_likelihoods(inverse_roots(covs), innovation, rows, ends, own)
        self.log_withheld = float(np.logaddexp.reduce(self.log_weights + found) - np.logaddexp.reduce(self.log_weights))
        self.log_weights = self.log_weights + self.prior.weight * found
        self.log_weights -= np.logaddexp.reduce(self.log_weights)


@dataclass(frozen=True, slots=True)
class WithheldGroups:
    """Groups of marks that are withheld together when one of them is predicted from the other marks.

    Two marks are withheld together if their distance is below the smallest distance between a mark and the target.
    So no mark is predicted from marks that are nearer to it than any mark is to the target.

    Attributes
    ----------
    near : mapping of str to tuple of str
        For each marked node, the other marked nodes near it.
    """

    near: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, network: MassSpringNetwork, marked: Sequence[str], point: TargetPoint) -> WithheldGroups:
        """Make the groups for these marked nodes of a network and this target."""
        places = {name: network.positions[network.index(name)] for name in marked}
        nodes = [network.positions[network.index(name)] for name in point.nodes]
        where = np.average(nodes, axis=0, weights=point.weights)
        reach = 0.99 * min(float(np.linalg.norm(place - where)) for place in places.values())
        return cls(
            {
                name: tuple(
                    other for other, there in places.items() if other != name and np.linalg.norm(there - place) < reach
                )
                for name, place in places.items()
            }
        )

    def __call__(self, names: Sequence[str], blocks: Sequence[slice]) -> Sequence[NDArray[np.int64]]:
        """One group for each mark, (k, dim): rows of the mark, then rows of the marks that are withheld with it."""
        rows = {name: np.arange(block.start, block.stop) for name, block in zip(names, blocks, strict=True)}
        return [
            np.array([rows[name], *(rows[other] for other in self.near[name] if other in rows)])
            for name in names
            if name in self.near
        ]
