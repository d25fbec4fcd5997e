"""The chain of states by which modes follow each other: states that act alike share a mode, and so a filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.arrays import Floats
from estimators.filters.exponential import small_expm

LEAST = 1e-100
"""Least probability of a state: none is ruled out for good, and none is divided by nothing."""

KEPT = 64
"""Transition matrices that are kept, at most: it bounds the memory of a camera whose times are all different."""

ROUNDED = 13
"""Decimals of a time step: at one rate steps differ in the last digits of the clock, and each would have its matrix."""


class ModeChain:
    """A Markov chain in continuous time, each of whose states is in one of some modes; in branches that never mix.

    rates: how often state i turns into state j [1/s], (n_states, n_states), rows summing to zero
    of_state: mode of each state, (n_states,)
    odds: probability of each state, one branch after the other, (n_branches n_states,)

    States of one mode differ in what comes next, not in how the tissue moves: so their odds are kept apart, and their
    beliefs are one.
    """

    def __init__(self, odds: ArrayLike, rates: ArrayLike, of_state: ArrayLike | None = None) -> None:
        self.odds: Floats = np.array(odds, dtype=np.float64)
        self.rates: Floats = np.asarray(rates, dtype=np.float64)
        own = np.arange(len(self.rates)) if of_state is None else np.asarray(of_state, dtype=np.intp)
        self.of_state: NDArray[np.intp] = own
        self.n_modes = int(own.max()) + 1
        self._transitions: dict[float, Floats] = {}
        self._set_branches(1)

    @property
    def n_branches(self) -> int:
        """How many branches there are."""
        return len(self._modes) // len(self.rates)

    @property
    def mode_odds(self) -> Floats:
        """Probability of each mode in each branch, (n_branches n_modes,)."""
        return np.bincount(self._modes, self.odds, len(self._members)).astype(np.float64)

    @property
    def branch_odds(self) -> Floats:
        """Probability of each branch, (n_branches,)."""
        return np.asarray(self.odds.reshape(self.n_branches, -1).sum(axis=1))

    @property
    def state_odds(self) -> Floats:
        """Probability of each state in whatever branch, (n_states,)."""
        return np.asarray(self.odds.reshape(self.n_branches, -1).sum(axis=0))

    def set_mode_odds(self, odds: Floats) -> None:
        """Give each mode these odds, (n_branches n_modes,); of its states as they were to each other."""
        total = self.mode_odds
        alike = 1.0 / np.bincount(self._modes, minlength=len(total))
        known = total > 0.0
        share = np.where(known[self._modes], self.odds / np.where(known, total, 1.0)[self._modes], alike[self._modes])
        self.odds = share * np.asarray(odds, dtype=np.float64)[self._modes]

    def resume(self, odds: Floats) -> bool:
        """Set the odds of the states to what they were, (n_branches n_states,); whether there were other branches."""
        n, before = len(odds) // len(self.rates), self.n_branches
        if n != before:
            self._set_branches(n)
        self.odds = odds
        return n != before

    def branch(self, odds: Floats) -> None:
        """Go on in branches of these odds, (n_branches,), in each with the odds of the states of now."""
        states = self.state_odds
        self._set_branches(len(odds))
        self.odds = np.asarray(np.kron(odds / np.sum(odds), states), dtype=np.float64)

    def _set_branches(self, n: int) -> None:
        self._modes = (self.n_modes * np.arange(n)[:, None] + self.of_state).ravel()
        self._members = np.eye(n * self.n_modes)[:, self._modes]

    def ahead(self, dt: float) -> tuple[Floats, Floats, Floats]:
        """Odds of the states dt [s] later, (n_branches n_states,), and of the modes; and the mixing weights.

        Weights (n, n), n all modes of all branches: of the belief in i now in that in j then.
        """
        own = self.odds.reshape(self.n_branches, -1)
        M = self._transition(dt)
        states = np.maximum((own @ M).ravel(), LEAST)
        both = np.zeros((len(self.odds), len(self.odds)))
        for k, odds in enumerate(own):
            at = slice(k * len(M), (k + 1) * len(M))
            both[at, at] = odds[:, None] * M
        # a mode that nothing leads to goes on from what it is
        joint = self._members @ both @ self._members.T + LEAST * np.eye(len(self._members))
        modes = joint.sum(axis=0)
        return states, modes, joint / modes

    def begun(self, weights: Floats, onset: Floats) -> Floats:
        """Variances that forces which have just begun add to each mode's mix, (n_branches n_modes, n).

        weights: of `ahead`; onset: variances of each mode's forces in the state, (n_modes, n). Who enters a mode whose
        forces vary more than those of the mode before has the rest of their variance at once.
        """
        k, n = self.n_modes, self.n_branches
        own = weights.reshape(n, k, n, k)[range(n), :, range(n)]
        return np.asarray(np.einsum("bij,ijn->bjn", own, rising(onset)).reshape(n * k, -1))

    def of_branches(self, logs: Floats) -> Floats:
        """Of log likelihoods by all modes, (n_branches n_modes,), that by the branch of each."""
        own, odds = logs.reshape(self.n_branches, -1), self.mode_odds.reshape(self.n_branches, -1)
        most = own.max(axis=1)
        found = most + np.log((odds * np.exp(own - most[:, None])).sum(axis=1) / odds.sum(axis=1))
        return np.repeat(found, own.shape[1])

    def weigh(self, likelihoods: Floats) -> float:
        """Take in how likely a measurement was by each mode, (n_branches n_modes,); the likelihood of it by all."""
        posterior = self.odds * likelihoods[self._modes]
        total = float(posterior.sum())
        odds = np.maximum(posterior / total, LEAST)
        self.odds = odds / odds.sum()
        return total

    def _transition(self, dt: float) -> Floats:
        """exp(rates dt); frames of one camera take few different times, but for rounding; their matrices are kept."""
        key = round(dt, ROUNDED)
        if (known := self._transitions.get(key)) is None:
            if len(self._transitions) >= KEPT:
                self._transitions.clear()
            known = self._transitions[key] = small_expm(self.rates * key)
        return known


def rising(variances: Floats) -> Floats:
    """By how much variances, (k, n), are larger in j than in i, where they are: (k, k, n), i first."""
    return np.asarray(np.maximum(variances - variances[:, None], 0.0))
