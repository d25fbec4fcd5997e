"""Branches of a mixture, one by one: beliefs that are followed side by side, and those that have become the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats
from estimators.filters.kernels import mixed_each, with_columns
from estimators.filters.mixture import InteractingMixture

ALIKE = 0.5
"""Squared distance of two branches' means, by the sum of their covariances, below which they are one; choice:
together they are then wider than each by a quarter at most."""

Belief = tuple[Floats, Floats, Floats]
"""Mean (n,), covariance (n, n) and columns (n, r)."""


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """One of the beliefs that a mixture follows.

    odds: of the states of the chain, together the branch's, (n_states,)
    means (n_modes, n), covs (n_modes, n, n), columns (n_modes, n, r): of its modes
    """

    odds: Floats
    means: Floats
    covs: Floats
    columns: Floats

    @classmethod
    def alike(cls, odds: Floats, belief: Belief, n_modes: int) -> Branch:
        """One with the same belief in every mode."""
        return cls(odds, *(np.repeat(each[None], n_modes, axis=0) for each in belief))

    def scaled(self, odds: Floats) -> Branch:
        """The branch with other odds of the chain's states, (n_states,)."""
        return Branch(odds, self.means, self.covs, self.columns)

    def merged(self, of_state: NDArray[np.intp]) -> Belief:
        """The moments of all its modes. of_state: mode of each state of the chain."""
        mu = np.bincount(of_state, self.odds, len(self.means))
        mean, cov, columns = mixed_each((mu / mu.sum())[:, None], self.means, self.covs, self.columns)
        return mean[0], cov[0], columns[0]

    def with_other(self, other: Branch, of_state: NDArray[np.intp]) -> Branch:
        """Both as one, mode by mode by their moments."""
        pairs = []
        for k in range(len(self.means)):
            weights = np.array([each.odds[of_state == k].sum() for each in (self, other)])
            both = (np.array([a[k], b[k]]) for a, b in zip(self._arrays(), other._arrays(), strict=True))
            pairs.append([each[0] for each in mixed_each((weights / weights.sum())[:, None], *both)])
        means, covs, columns = (np.array(each) for each in zip(*pairs, strict=True))
        return Branch(self.odds + other.odds, means, covs, columns)

    def _arrays(self) -> tuple[Floats, Floats, Floats]:
        return self.means, self.covs, self.columns


def branches_of(mixture: InteractingMixture) -> list[Branch]:
    """The branches of a mixture as they are now."""
    n, now = mixture.n_branches, mixture.beliefs()
    parts = (mixture.chain.odds, now.means, now.covs, mixture.columns)
    return [Branch(*each) for each in zip(*(np.split(part, n) for part in parts), strict=True)]


def follow(mixture: InteractingMixture, branches: Sequence[Branch]) -> None:
    """Have a mixture follow these branches, and no other, from now on; their odds are made to sum to 1."""
    odds = np.concatenate([branch.odds for branch in branches])
    mixture.resume(odds / odds.sum())
    mixture.cycle = None
    means, covs, columns = (np.concatenate(each) for each in zip(*(one._arrays() for one in branches), strict=True))
    for f, x, P in zip(mixture.filters, means, covs, strict=True):
        f.x, f.P = x, P
    mixture.columns = columns
    xs, Ps, mean_columns = mixed_each(mixture.mu[:, None], means, covs, columns)
    mixture.x, mixture.P = xs[0], with_columns(Ps[0], mean_columns[0])


def prune(mixture: InteractingMixture, least: float) -> None:
    """Give up branches that are less probable than this, but for the most probable; counted as `pruned`."""
    odds = mixture.branch_odds
    kept = odds >= min(least, float(odds.max()))
    if not kept.all():
        mixture.repairs["pruned"] += int((~kept).sum())
        follow(mixture, [branch for branch, one in zip(branches_of(mixture), kept, strict=True) if one])


def merge_alike(mixture: InteractingMixture) -> None:
    """Merge branches that have come to the same belief; counted as `merged`."""
    if mixture.n_branches == 1:
        return
    of_state, branches = mixture.chain.of_state, branches_of(mixture)
    beliefs = [branch.merged(of_state) for branch in branches]
    before, i = len(branches), 0
    while i < len(branches):
        j = i + 1
        while j < len(branches):
            if _are_alike(beliefs[i], beliefs[j]):
                branches[i] = branches[i].with_other(branches.pop(j), of_state)
                beliefs.pop(j)
                beliefs[i] = branches[i].merged(of_state)
            else:
                j += 1
        i += 1
    if len(branches) < before:
        mixture.repairs["merged"] += before - len(branches)
        follow(mixture, branches)


def _are_alike(one: Belief, other: Belief) -> bool:
    apart, S = one[0] - other[0], one[1] + other[1]
    if (apart**2 >= ALIKE * np.diag(S)).any():  # no coordinate is further away than all together
        return False
    return float(apart @ np.linalg.solve(S, apart)) < ALIKE
