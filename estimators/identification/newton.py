"""The minimum of a function of a few variables that is costly and a little rough, by Newton's method along the axes.

As is the likelihood of a recording, which gates and merged modes make uneven. A simplex needs some fifty values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Floats

SHORTEST, LONGEST = 0.05, 0.3
"""Least and largest step of a difference, two standard errors between them; numerical: below these a rough function's
slope is that of its roughness, above them its third derivative counts."""

LONGEST_MOVE = 1.0
"""Of a variable at once; numerical: further a quadratic means nothing."""

HALVINGS = 3
"""Of a move that leads up before it is given up; numerical."""

WALL = 10.0
"""By how much the function counts as higher where it is not finite; numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """Where a search ended: x (n,), value there, curvature along the axes about there, (n,)."""

    x: Floats
    value: float
    curvature: Floats


def minimum(
    cost: Callable[[Floats], float],
    start: Floats,
    least: Floats,
    *,
    tolerance: float,
    curvature: Floats | None = None,
    costs: Callable[[Sequence[Floats]], Sequence[float]] | None = None,
) -> Minimum:
    """Where a function of x (n,), in units in which 1 is far, is the least, by a last step that had little to bring.

    Slopes and curvatures are central differences; mixed derivatives are left out, for a step costs as many values more.
    least: curvature along the axes that it has at least, as that of a prior, (n,); curvature: about the start, if known
    tolerance: what the last step may promise, or bring, in units of the function: where steps bring less than they
        promise, the function is rough by that; costs: of several places, where that is quicker
    Where the function is not finite at the start, the search ends there with the least curvature.
    """
    best, lowest = start, cost(start)
    if not np.isfinite(lowest):
        return Minimum(start, lowest, least)

    def asked(*places: Floats) -> list[float]:
        values = [cost(x) for x in places] if costs is None else costs(places)
        return [value if np.isfinite(value) else lowest + WALL for value in values]

    found = least if curvature is None else curvature
    while True:
        steps = np.clip(2.0 / np.sqrt(found), SHORTEST, LONGEST)
        beside = [best + move for move in np.concatenate([np.diag(steps), -np.diag(steps)])]
        values = np.array(asked(*beside))
        ahead, behind = values.reshape(2, -1)
        slope = (ahead - behind) / (2.0 * steps)
        found = np.maximum((ahead + behind - 2.0 * lowest) / steps**2, least)
        move = np.clip(-slope / found, -LONGEST_MOVE, LONGEST_MOVE)
        promised = 0.5 * float(np.sum(slope**2 / found))
        before, tried = lowest, best + move
        for _ in range(HALVINGS if promised >= tolerance else 1):
            if (value := asked(tried)[0]) < before:
                best, lowest = tried, value
                break
            tried = 0.5 * (best + tried)
        if values.min() < lowest:
            best, lowest = beside[int(values.argmin())], float(values.min())
        if promised < tolerance or not before - lowest >= tolerance:
            return Minimum(best, lowest, found)
