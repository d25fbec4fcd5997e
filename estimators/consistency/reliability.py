"""Reliability of predicted probabilities: observed hit rate and mean prediction in each of ten bins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta


@dataclass(frozen=True, slots=True)
class ReliabilityBin:
    """Predictions with probabilities from `low` to `high`, such as 0.3 to 0.4, and the observed number of hits.

    n: number of predictions; mean: mean predicted probability, None if n is 0; hits: number of observed hits
    least, most: confidence interval of the true hit rate, by Clopper and Pearson [clopper1934]
    inside: whether the mean predicted probability lies in this interval; True if n is 0
    """

    low: float
    high: float
    n: int
    mean: float | None
    hits: int
    least: float
    most: float
    inside: bool


def clopper_pearson(hits: int, n: int, level: float = 0.99) -> tuple[float, float]:
    """Confidence interval of a hit rate, from the number of hits in n trials; (0, 1) for n = 0."""
    if not 0 <= hits <= n or not 0.0 < level < 1.0:
        raise ValueError(f"clopper_pearson: expected 0 <= hits <= n, 0 < level < 1, found {hits}, {n}, {level}")
    tail = 0.5 * (1.0 - level)
    least = 0.0 if hits == 0 else float(beta.ppf(tail, hits, n - hits + 1))
    most = 1.0 if hits == n else float(beta.ppf(1.0 - tail, hits + 1, n - hits))
    return least, most


def reliability_bins(
    predicted: ArrayLike, hit: Sequence[bool] | ArrayLike, *, level: float = 0.99
) -> tuple[ReliabilityBin, ...]:
    """Predictions and observed hits, sorted into ten bins by predicted probability.

    predicted: predicted probabilities, (n,); hit: whether each prediction was a hit, (n,)
    A bin includes its lower limit, but not its upper limit; the last bin also includes 1. Raises ValueError for
    probabilities below 0 or above 1, and for arrays of different length.
    """
    p, came = np.asarray(predicted, dtype=float), np.asarray(hit, dtype=bool)
    if p.ndim != 1 or p.shape != came.shape:
        raise ValueError(f"reliability_bins: expected as many hits as predictions, found {came.shape} and {p.shape}")
    if not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError("predicted: expected probabilities from 0 to 1, found others")
    edges = np.linspace(0.0, 1.0, 11).round(1)
    which = np.minimum(np.searchsorted(edges, p, side="right") - 1, 9)
    rows = []
    for k in range(10):
        own = which == k
        n, hits = int(own.sum()), int(came[own].sum())
        least, most = clopper_pearson(hits, n, level)
        mean = float(p[own].mean()) if n else None
        inside = mean is None or least <= mean <= most
        rows.append(ReliabilityBin(float(edges[k]), float(edges[k + 1]), n, mean, hits, least, most, inside))
    return tuple(rows)
