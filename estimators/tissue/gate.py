"""What was seen beyond the gate, and whether it is seen there again: an outlier seldom comes twice to one place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.filters.kernels import squared_mahalanobis
from estimators.tissue.settings import FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class Outlying:
    """What was last seen beyond the gate: a mark or a fix.

    since_s, last_s: since when it has been seen there without a break, and when last [s]
    position, cov: of the last one [m], (dim,), [m²], (dim, dim)
    """

    since_s: float
    last_s: float
    position: Floats
    cov: Floats


def confirmed(known: Outlying, now: Outlying, settings: FilterSettings) -> bool:
    """Whether what was seen now lies within the gate of what was seen then, moved by an impulse meanwhile."""
    reach = settings.impulse_m_s * min(now.last_s - known.last_s, settings.impulse_s)
    y = now.position - known.position
    S = known.cov + now.cov + reach**2 * np.eye(len(y))
    return float(squared_mahalanobis(y, S)) <= settings.gate
