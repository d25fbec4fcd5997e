"""Gate for measurements. A measurement outside it is rejected, unless it is near the last rejected measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.filters.kernels import squared_mahalanobis
from estimators.tissue.settings import FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class Outlying:
    """The last measurement that was outside the gate.

    since_s, last_s: times of the first and the last of consecutive measurements outside the gate [s]
    position, cov: the last measurement [m], (dim,), and its covariance [m²], (dim, dim)
    """

    since_s: float
    last_s: float
    position: Floats
    cov: Floats


def confirmed(known: Outlying, now: Outlying, settings: FilterSettings) -> bool:
    """Whether `now` is in the gate around the earlier `known`. The gate allows for an impulse between the two."""
    reach = settings.impulse_m_s * min(now.last_s - known.last_s, settings.impulse_s)
    y = now.position - known.position
    S = known.cov + now.cov + reach**2 * np.eye(len(y))
    return float(squared_mahalanobis(y, S)) <= settings.gate
