"""The exponential of small matrices, without BLAS threads."""

from __future__ import annotations

import numpy as np

from estimators.arrays import Floats

TERMS = 18
"""Terms of the Taylor series; with a norm of at most 1/2 the next is below 1e-22."""


def small_expm(A: Floats) -> Floats:
    """exp(A), (n, n), by scaling, Taylor's series and squaring.

    For the few states of a Markov chain or of one coordinate's motion, several times a frame. SciPy's expm is the
    reference in the tests; on a machine whose cores are busy it waits some 16 ms for its BLAS threads.
    """
    norm = float(np.abs(A).sum(axis=1).max())
    halvings = max(0, int(np.ceil(np.log2(norm))) + 1) if norm > 0.0 else 0
    scaled = A / 2.0**halvings
    identity = np.eye(len(A))
    # Horner: I + A (I + A/2 (I + A/3 ( ... )))
    power = identity
    for k in range(TERMS, 0, -1):
        power = identity + (scaled @ power) / k
    for _ in range(halvings):
        power = power @ power
    return power
