"""Measurements beyond the gate, and whether they repeat: an outlier seldom comes to the same place twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats
from estimators.filters.kernels import squared_mahalanobis
from estimators.tissue.settings import FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class Outlying:
    """The last measurement beyond the gate: a mark or a fix.

    since_s, last_s: when it was first seen there without a break since, and when last [s]
    position, cov: of the last one [m], (dim,), [m²], (dim, dim)
    """

    since_s: float
    last_s: float
    position: Floats
    cov: Floats


def confirmed(known: Outlying, now: Outlying, settings: FilterSettings) -> bool:
    """Whether the present measurement lies within the gate about the earlier one, with an impulse between them."""
    reach = settings.impulse_m_s * min(now.last_s - known.last_s, settings.impulse_s)
    y = now.position - known.position
    S = known.cov + now.cov + reach**2 * np.eye(len(y))
    return float(squared_mahalanobis(y, S)) <= settings.gate
