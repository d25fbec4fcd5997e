"""How the modes of a mixture move, by sigma points or to first order, and what is kept of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class LinearMotion:
    """Motion of k modes to first order about states: x -> ends + F (x - about) + noise.

    ends (k, n): of the states themselves; F, Q (k, n, n); added (k, n, r): to what F makes of the columns
    white (k, n, m): a root of the part of Q that is white noise
    n_coupled: states from this one on are moved by themselves alone: their rows of F have no entry off the diagonal
    straight (n,): how far an end may be from `ends` for F to hold there; 0 where that is not known
    """

    ends: Floats
    F: Floats
    Q: Floats
    added: Floats
    white: Floats
    n_coupled: int
    straight: Floats

    def chosen(self, other: LinearMotion, better: NDArray[np.bool_]) -> LinearMotion:
        """The motion of the modes where the other is better, (k,), by the other; of the rest by this."""
        m = max(self.white.shape[2], other.white.shape[2])
        own, new = (
            (each.ends, each.F, each.Q, each.added, np.pad(each.white, ((0, 0), (0, 0), (0, m - each.white.shape[2]))))
            for each in (self, other)
        )
        picked = (np.where(better.reshape(-1, *[1] * (a.ndim - 1)), b, a) for a, b in zip(own, new, strict=True))
        ends, F, Q, added, white = picked
        return LinearMotion(ends, F, Q, added, white, self.n_coupled, self.straight)

    def predicted(self, covs: Floats) -> Floats:
        """F P F' + Q of covariances P, (k, n, n), symmetric to the last bit."""
        t, Ps = self.n_coupled, np.empty_like(covs)
        for P, cov, F, Q in zip(Ps, covs, self.F, self.Q, strict=True):
            rows, own = F[:t], np.diagonal(F)[t:]
            across = cov @ rows.T
            P[:t, :t] = rows @ across
            P[t:, :t] = own[:, None] * across[t:]
            P[:t, t:] = P[t:, :t].T
            P[t:, t:] = cov[t:, t:] * np.outer(own, own)
            P[:] = 0.5 * ((P + Q) + (P + Q).T)
        return Ps


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """The last prediction of a linearised motion, kept for the update that follows.

    means, covs, columns: of each mode at its start; mixed: covariances before forces set in; motion(about (k, n)): the
        motion linearised there
    passes: how often at most it may be linearised; about: where it was last; found: the motion there
    seconds: how long it is [s]; first: the most probable mode at its end
    """

    means: Floats
    mixed: Floats
    covs: Floats
    columns: Floats
    motion: Callable[[Floats], LinearMotion]
    passes: int
    about: Floats
    found: LinearMotion
    seconds: float
    first: int

    @property
    def of_first(self) -> tuple[Floats, Floats, float]:
        """Of the most probable mode F (n, n), and what white noise added to its covariance, (n, n); seconds."""
        root = self.found.white[self.first]
        return self.found.F[self.first], root @ root.T, self.seconds


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """How all modes move at once.

    points(points (k, n_points, n), dt): where they are dt [s] later, of the same shape
    columns(means (k, n), columns (k, n, r), dt): what the columns make of the means' errors dt [s] later
    turned(points): which modes have points where the model must not be asked, (k,)
    linear(dt, level): where sigma points are not to be used, the motion of all modes over the next dt [s] by the states
        about which it is linearised, white noise having this factor on its variance, and in how many passes at most an
        update may ask for it
    """

    points: Callable[[Floats, float], Floats]
    columns: Callable[[Floats, Floats, float], Floats] | None = None
    turned: Callable[[Floats], NDArray[np.bool_]] | None = None
    linear: Callable[[float, float], tuple[Callable[[Floats], LinearMotion], int]] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ModeBeliefs:
    """Mode by mode: odds mu (k,), means (k, n), covariances (k, n, n)."""

    mu: Floats
    means: Floats
    covs: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Transition:
    """What one cycle of prediction did, for a smoother.

    weights (k, k): of mode i in the mix that mode j starts from; means, covs: of each mode's mix, (k, n), (k, n, n)
    F (k, n, n): transition matrices; arrived: the beliefs at the end, before any measurement
    """

    weights: Floats
    means: Floats
    covs: Floats
    F: Floats
    arrived: ModeBeliefs
