"""What is believed of a position: a Gaussian mixture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class GaussianMixture:
    """A Gaussian mixture: weights (k,) that sum to one, means [m] (k, dim), covs [m²] (k, dim, dim)."""

    weights: Floats
    means: Floats
    covs: Floats

    def __post_init__(self) -> None:
        k, dim = self.means.shape
        if self.weights.shape != (k,) or self.covs.shape != (k, dim, dim):
            raise ValueError(
                f"belief: expected shapes {(k,)}, {(k, dim)} and {(k, dim, dim)}, "
                f"found {self.weights.shape}, {self.means.shape} and {self.covs.shape}"
            )
        if not (np.all(self.weights >= 0.0) and abs(self.weights.sum() - 1.0) < 1e-9):
            raise ValueError(f"belief weights: expected 0 or more that sum to 1, found {self.weights}")

    @classmethod
    def gaussian(cls, mean: Floats, cov: Floats) -> GaussianMixture:
        """A single Gaussian: mean [m], (dim,), cov [m²], (dim, dim)."""
        return cls(np.ones(1), np.asarray(mean, dtype=float)[None], np.asarray(cov, dtype=float)[None])
