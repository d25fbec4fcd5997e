"""Discrepancy, which is the displacement that the model leaves out, and estimate of its standard deviation."""

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

SOLID_LEVELS, SOLID_LEAST, SOLID_LOOSE = (0.005, 0.015, 0.05), 5e-3, 0.05
"""`Discrepancy.levels`, `least` and `loose` for a continuum: its strains are small, its wall may move [1]; choice."""

JITTER = 1e-6
"""Variance added at fixed nodes before a linear system is solved, relative to the field's variance [1]; numerical."""


def factor(cov: Floats, rank: int, least: float = 1e-3) -> Floats:
    """Columns L (n, r) for which `L L'` approximates a covariance (n, n). The number r is at most `rank`.

    least: smallest eigenvalue that is used, relative to the largest eigenvalue
    """
    values, vectors = np.linalg.eigh(cov)
    kept = np.flatnonzero(values > least * values[-1])[::-1][:rank]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


@dataclass(frozen=True, slots=True)
class Discrepancy:
    """Prior of the displacement that the model leaves out, as the sum of a long-range and a short-range random field.

    Attributes
    ----------
    levels : tuple of float
        Possible standard deviations of the long-range field, relative to the extent of the network's nodes [1];
        choice. All are equally probable.
    noises : tuple of (float, float)
        Possible factors on the standard deviation of the marks' noise, each with its prior probability [1]; choice.
    short : float
        Ratio of the standard deviations of the short-range and the long-range field [1]; choice.
    lengths : tuple of float
        Correlation lengths of the long-range and short-range field, relative to the extent of the nodes [1]; choice.
    lasting_s : float
        Correlation time of both fields [s]; choice.
    memory_s : float
        Time constant with which earlier frames lose weight in the estimate of the standard deviation [s]; choice.
    weight : float
        Factor on the log likelihood of each frame [1]; choice. A factor below 1 allows for correlated frames.
    rank : int
        Largest number of basis functions of the displacement on each axis; numerical.
    least : float
        Smallest variance of a basis function, relative to the largest variance [1]; numerical.
    loose : float
        Share of the fields' variance that remains at fixed nodes, because these may move, too [1]; choice.
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
    loose: float = 0.0

    @classmethod
    def of(cls, settings: FilterSettings, *, solid: bool = False) -> Discrepancy:
        """Make the prior from the settings of the filter. `solid` states whether the body is a continuum."""
        prior = cls(levels=SOLID_LEVELS, least=SOLID_LEAST, loose=SOLID_LOOSE) if solid else cls()
        return prior if settings.discrepancy is None else replace(prior, levels=(settings.discrepancy,))

    def field(self, places: Floats, held: Floats) -> tuple[Floats, Floats]:
        """Basis functions of the displacement [m], (n, r), and the variance that they omit at each node [m²], (n,).

        places: positions of the n free nodes [m], (n, dim)
        held: positions of fixed nodes, where the share `loose` of the variance remains [m], (any, dim)
        Both results are for a long-range field whose standard deviation equals the extent of these positions (level 1).
        """
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
            own = own - (1.0 - self.loose) * cov[:n, n:] @ np.linalg.solve(fixed, cov[n:, :n])  # type: ignore[index]
        found = factor(own, self.rank, self.least)
        return extent * found, extent**2 * np.maximum(own.diagonal() - (found**2).sum(axis=1), 0.0)


class LevelPosterior:
    """Posterior of the discrepancy's standard deviation (its level) and of a factor on the noise of the marks.

    Each mark is predicted from other marks, and the likelihoods of these predictions weight the levels. The joint
    likelihood of all marks would favour levels that are too small.

    State: log_weights, from which follow level, the estimated standard deviation of the discrepancy relative to the
    extent of the nodes [1], and noise, the estimated factor on the standard deviation of the marks' noise [1];
    log_withheld, the log likelihood of the last frame's marks, each predicted from other marks.
    """

    def __init__(self, prior: Discrepancy) -> None:
        noises, odds = np.array(prior.noises).T
        self.prior, self.levels = prior, np.repeat(prior.levels, len(noises))
        self.noises = np.tile(noises, len(prior.levels))
        self.log_prior = np.log(np.tile(odds / odds.sum(), len(prior.levels)) / len(prior.levels))
        self.log_weights = self.log_prior.copy()
        self.log_withheld = 0.0

    @property
    def log_weights(self) -> Floats:
        """Log probability of each pair of level and noise factor, up to a constant, (n,)."""
        return self._log_weights

    @log_weights.setter
    def log_weights(self, log_weights: Floats) -> None:
        weights = np.exp(log_weights - log_weights.max())
        self._log_weights, shares = log_weights, weights / weights.sum()
        self.level, self.noise = (float(np.sqrt(shares @ values**2)) for values in (self.levels, self.noises))

    def forget(self, dt: float) -> None:
        """Reduce the weight of earlier frames after a time step dt [s]."""
        kept = np.exp(-dt / self.prior.memory_s)
        self.log_weights = kept * self.log_weights + (1.0 - kept) * self.log_prior

    def update(
        self, innovation: Floats, S: Floats, fresh: Floats, R: Floats, groups: Sequence[NDArray[np.int64]]
    ) -> None:
        """Update the probabilities of levels and noise factors with the marks of a frame.

        Parameters
        ----------
        innovation, S : (m,), (m, m)
            Innovation of all observations and its covariance, at the estimated level and noise factor.
        fresh : (m, m)
            Covariance of the marks due to the discrepancy that arose since the last frame, at level 1.
        R : (m, m)
            Covariance of the noise of the marks, at the estimated noise factor.
        groups : sequence of (k, dim) int
            Row indices of the marks, as a `WithheldGroups` returns them. If there are none, nothing changes.
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
        log_weights = self.log_weights + self.prior.weight * found
        self.log_weights = log_weights - np.logaddexp.reduce(log_weights)


@dataclass(frozen=True, slots=True)
class WithheldGroups:
    """Marks that are left out together when a mark is predicted from the other marks.

    Two marks do not predict each other if they are nearer to each other than the target is to its nearest mark.

    Attributes
    ----------
    near : mapping of str to tuple of str
        For each marked node, the marked nodes that are too near to predict it.
    """

    near: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, network: MassSpringNetwork, marked: Sequence[str], point: TargetPoint) -> WithheldGroups:
        """Make the groups for the marked nodes of a network and for a target."""
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
        """For each mark, an array (k, dim) of indices: rows of the mark, then rows of marks too near to predict it."""
        rows = {name: np.arange(block.start, block.stop) for name, block in zip(names, blocks, strict=True)}
        return [
            np.array([rows[name], *(rows[other] for other in self.near[name] if other in rows)])
            for name in names
            if name in self.near
        ]
