"""Of the errors of a measurement, what is beside its noise: those that several have in common, and outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats

REMEMBERED_S = 5.0
"""For so long innovations tell of common errors [s]; choice: with 60 s errors and coverage are the same."""


class Outliers(NamedTuple):
    """What a part of a measurement, `width` coordinates that come together, may be besides what it claims to be.

    variance: added to that of its noise, in the units of z squared; log_odds: log of how often that is so
    """

    width: int
    variance: float
    log_odds: float


@dataclass(frozen=True, slots=True, eq=False)
class CommonErrors:
    """Errors that all measurements have in common, as far as innovations tell of them: for the odds of modes alone.

    A camera's calibration errs alike in all frames. A mode that is asked of each frame by itself whether such an error
    explains it gets the same answer from every one, and pokes that do explain the marks no better odds.

    moving: (r,), which of the errors, of unit variance at first, have moved a measurement itself. The others are taken
    as known: those of constants err as forces do, and drawn anew in each frame would let any mode explain what only
    another's forces can.
    mean (r,), cov (r, r) [1]: of the errors, nought where they are taken as known
    """

    moving: NDArray[np.bool_]
    mean: Floats
    cov: Floats

    @classmethod
    def unknown(cls, n: int) -> CommonErrors:
        """So many errors of which nothing was told."""
        return cls(np.zeros(n, dtype=bool), np.zeros(n), np.zeros((n, n)))

    def later(self, dt: float) -> CommonErrors:
        """After dt [s]: what was told is slowly forgotten."""
        if not self.moving.any():
            return self
        kept = float(np.exp(-dt / REMEMBERED_S))
        cov = kept**2 * self.cov + (1.0 - kept**2) * np.diag(self.moving.astype(np.float64))
        return CommonErrors(self.moving, kept * self.mean, cov)

    def moved_by(self, shared: Floats) -> CommonErrors:
        """With those that move a measurement by shared (m, r)."""
        known = self if len(self.mean) == shared.shape[1] else CommonErrors.unknown(shared.shape[1])
        moving = known.moving | (shared != 0.0).any(axis=0)
        fresh = (moving & ~known.moving).astype(np.float64)
        return CommonErrors(moving, known.mean, known.cov + np.diag(fresh)) if fresh.any() else known

    @property
    def root(self) -> Floats:
        """Root L of the covariance, L L', (r, number of those that move)."""
        root = np.zeros((len(self.mean), int(self.moving.sum())))
        root[self.moving] = np.linalg.cholesky(self.cov[np.ix_(self.moving, self.moving)])
        return root

    def told(self, ys: Sequence[Floats], covs: Sequence[Floats], columns: Floats, mu: Floats) -> CommonErrors:
        """After innovations ys of the modes, (m,) each, of covariances (m, m), by the modes' odds mu, (n_modes,).

        columns: what the errors make of the innovations, (n_modes, m, r)
        """
        if not self.moving.any():
            return self
        y, C = np.asarray(mu @ np.array(ys)), np.einsum("k,kij->ij", mu, columns)
        S = sum(w * (cov + np.outer(one - y, one - y)) for w, one, cov in zip(mu, ys, covs, strict=True))
        CV = C @ self.cov
        gain = np.linalg.solve(CV @ C.T + S, CV).T
        cov = self.cov - gain @ CV
        return CommonErrors(self.moving, self.mean + gain @ (y - C @ self.mean), 0.5 * (cov + cov.T))
