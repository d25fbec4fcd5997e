"""A step of Newton's method on the likelihood itself, by differences, from where its scores vanish.

Scores follow the error of a filter whose gain stays as it is. What constants do to gains they leave out, and noise of
the marks in estimated velocities, which is in innovations and sensitivities alike, passes for information: such scores
do not vanish where constants are right, and their information is several times too large along a few directions.
The likelihood has neither fault. Source: [ljung1979].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Floats

STEP = 0.7
"""Of the differences, in standard errors: numerical, a likelihood falls by a quarter over it."""

INFORMED = 1.2
"""Precision by that of the prior from which on a direction's curvature is measured: below, the prior decides."""

CERTAIN = 400.0
"""Precision by that of the prior up to which it is: beyond, velocities hardly matter, and scores are right to a few
percent; numerical."""

MOST_MEASURED = 16
"""Directions whose curvature is measured, those that the recording says the least about first: the cost grows with the
square; numerical."""

SHARES = (1.0, 0.5, 0.25, 0.1)
"""Of the step, of which the most probable is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class Likeliest:
    """Where the step ended, theta (n,) in prior standard deviations, and the information of the likelihood, (n, n)."""

    theta: Floats
    information: Floats


def likeliest(
    log_likelihoods: Callable[[Sequence[Floats]], Floats],
    moved: Callable[[Floats], Floats],
    start: Floats,
    precision: Floats,
) -> Likeliest | None:
    """The most probable constants about a start, (n,), and what the likelihood knows of them; None where not finite.

    log_likelihoods: at several points; moved: the start moved by so much, along the curves on which likelihoods are the
    most like a parabola; precision: of scores and prior at the start, (n, n)
    """
    values, axes = np.linalg.eigh(precision)
    directions = axes / np.sqrt(values)  # each by its standard error
    measured = np.flatnonzero((values > INFORMED) & (values < CERTAIN))[:MOST_MEASURED]
    pairs = list(combinations(measured, 2))
    single = STEP * directions.T
    double = [single[i] + single[j] for i, j in pairs]
    moves = [*single, *-single, *double, *(-move for move in double)]
    found = log_likelihoods([start, *(moved(move) for move in moves)])
    if not np.isfinite(found).all():
        return None
    n, middle = len(start), found[0]
    ahead, behind = found[1 : 1 + n], found[1 + n : 1 + 2 * n]
    both = found[1 + 2 * n :].reshape(2, -1).sum(axis=0)
    gradient = (ahead - behind) / (2.0 * STEP)
    bends = (2.0 * middle - ahead - behind) / STEP**2
    information = np.diag(1.0 - 1.0 / values)
    information[measured, measured] = bends[measured]
    for (i, j), sum_of_two in zip(pairs, both, strict=True):
        mixed = ahead[i] + behind[i] + ahead[j] + behind[j] - sum_of_two - 2.0 * middle
        information[i, j] = information[j, i] = mixed / (2.0 * STEP**2)
    information = _not_negative(information, measured)
    posterior = information + np.diag(1.0 / values)
    step = np.linalg.solve(posterior, gradient - directions.T @ start)
    ends = [moved(directions @ (share * step)) for share in SHARES]
    gains = log_likelihoods(ends) - [0.5 * float(end @ end) for end in ends]
    best = int(np.argmax(gains))
    back = axes * np.sqrt(values)
    theta = ends[best] if gains[best] > middle - 0.5 * float(start @ start) else start
    return Likeliest(theta, back @ information @ back.T)


def _not_negative(information: Floats, measured: NDArray[np.intp]) -> Floats:
    """The information (n, n) without negative values among the measured directions."""
    own = np.ix_(measured, measured)
    values, axes = np.linalg.eigh(information[own])
    positive = information.copy()
    positive[own] = (axes * np.maximum(values, 0.0)) @ axes.T
    return positive
