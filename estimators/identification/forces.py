"""Strength of the unknown forces on a continuum in a calibration recording, estimated before the constants.

The filter derives this strength from the stiffness of the body. If the true forces are stronger, the filter predicts
too little motion of the hidden marks, which a wrong stiffness would explain.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from estimators.identification.budget import OutOfTimeError
from estimators.identification.filter_pass import Frames
from estimators.identification.problem import STRENGTH_PASSES, Problem

FACTOR = 3.0
"""Prior of the strength: a log-normal distribution with this factor as one standard deviation [1]; choice."""

FURTHEST = 30.0
"""Largest factor on the strength, and inverse of the smallest one [1]; choice: three prior standard deviations."""

TOLERANCE = 0.3
"""Tolerance of the logarithm of the strength [1]; choice."""

FAILED = 1e12
"""Value that the search minimises where the filter fails numerically; numerical."""

MOST_TIME = 0.5
"""Share of the time limit after which no further strength is tried [1]; choice."""


def with_likely_forces(problem: Problem, frames: Frames) -> Problem:
    """The problem with the most probable strength of the unknown forces, given the constants of its network.

    A network of springs is returned unchanged, because its settings state the forces. If the time ends, the result is
    the most probable strength so far.
    """
    if problem.network.continuum is None:
        return problem
    given, costs = np.zeros(len(problem.groups)), {0.0: FAILED}

    def scaled(log: float) -> Problem:
        forces = problem.settings.poked
        stronger = replace(forces, poke=forces.poke * float(np.exp(log)))
        return replace(problem, settings=replace(problem.settings, poked=stronger))

    def cost(log: float) -> float:
        if problem.budget.share > MOST_TIME:
            raise OutOfTimeError
        log_likelihood = scaled(log).at(given, frames).log_likelihood
        costs[log] = min(0.5 * (log / np.log(FACTOR)) ** 2 - log_likelihood, FAILED)
        return costs[log]

    limit = float(np.log(FURTHEST))
    chosen = {"xatol": TOLERANCE, "maxiter": STRENGTH_PASSES}
    with suppress(OutOfTimeError):
        minimize_scalar(cost, bounds=(-limit, limit), method="bounded", options=chosen)
    return scaled(min(costs, key=costs.__getitem__))
