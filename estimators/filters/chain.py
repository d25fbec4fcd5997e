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
    """A Markov chain in continuous time, each of whose states is in one of some modes.

    rates: how often state i turns into state j [1/s], (n_states, n_states), rows summing to zero
    of_state: mode of each state, (n_states,)
    odds: probability of each state, (n_states,)

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
        self._members = np.eye(self.n_modes)[:, own]

    @property
    def mode_odds(self) -> Floats:
        """Probability of each mode, (n_modes,)."""
        return np.bincount(self.of_state, self.odds, self.n_modes).astype(np.float64)

    def set_mode_odds(self, odds: Floats) -> None:
        """Give each mode these odds, (n_modes,); of its states as they were to each other."""
        total, own = self.mode_odds, self.of_state
        alike = 1.0 / np.bincount(own, minlength=len(total))
        known = total > 0.0
        share = np.where(known[own], self.odds / np.where(known, total, 1.0)[own], alike[own])
        self.odds = share * np.asarray(odds, dtype=np.float64)[own]

    def ahead(self, dt: float) -> tuple[Floats, Floats, Floats]:
        """Odds of the states dt [s] later, (n_states,), and of the modes; and the mixing weights.

        Weights (n_modes, n_modes): of the posterior of mode i now in the prior of mode j then.
        """
        M = self._transition(dt)
        states = np.maximum(self.odds @ M, LEAST)
        # a mode that nothing leads to goes on from what it is
        joint = self._members @ (self.odds[:, None] * M) @ self._members.T + LEAST * np.eye(self.n_modes)
        modes = joint.sum(axis=0)
        return states, modes, joint / modes

    def begun(self, weights: Floats, onset: Floats) -> Floats:
        """Variances that forces which have just begun add to each mode's mix, (n_modes, n).

        weights: of `ahead`; onset: variances of each mode's forces in the state, (n_modes, n). Who enters a mode whose
        forces vary more than those of the mode before has the rest of their variance at once.
        """
        return np.asarray(np.einsum("ij,ijn->jn", weights, rising(onset)))

    def weigh(self, likelihoods: Floats) -> float:
        """Take in how likely a measurement was by each mode, (n_modes,); the likelihood of it by all."""
        posterior = self.odds * likelihoods[self.of_state]
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
