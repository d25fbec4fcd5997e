"""Constants under the forces of a recording: forces and constants found in turn, then the score centred."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import OutOfTimeError
from estimators.identification.filter_pass import Pass
from estimators.identification.forced.centring import score_moments
from estimators.identification.forced.forced_filter import Forces
from estimators.identification.forced.forces import Recorded, find_forces, forced_pass
from estimators.identification.search import Optimum, gauss_newton

IN_TURN = 2
"""Times that forces are found, then constants; numerical: the first time errors of the model pass for pokes."""


@dataclass(frozen=True, slots=True, eq=False)
class Scaled:
    """Constants in prior standard deviations: the network at such a point, its uncertainty there, and the units.

    unit: prior standard deviation of the log of each constant, (n,); note: called before each pass
    """

    model: Callable[[Floats], MassSpringNetwork]
    prior: Callable[[MassSpringNetwork], ParameterUncertainty]
    unit: Floats
    note: Callable[[], None]

    def passed(self, theta: Floats, seen: Recorded, forces: Forces) -> Pass:
        """The forced filter through the frames at a point."""
        self.note()
        network = self.model(theta)
        return forced_pass(network, self.prior(network), seen, forces)


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Constants under known forces: where the search ended, the pass with the constants given, under the same forces.

    mean_cov: what simulation leaves uncertain of the score's mean, (n, n)
    """

    optimum: Optimum
    given: Pass
    forces: Forces
    mean_cov: Floats


def under_forces(scaled: Scaled, seen: Recorded, start: Floats) -> Refined | None:
    """The constants that are the most probable under the forces of the recording, their score centred.

    None where there is no finite state; not centred where simulation has none, or no time for that. Raises
    OutOfTimeError before a first result.
    """
    found = _in_turn(scaled, seen, start)
    return None if found is None else _centred(scaled, seen, found)


def _in_turn(scaled: Scaled, seen: Recorded, start: Floats) -> Refined | None:
    """Forces, then constants under them, and so again. Raises OutOfTimeError before the first end."""
    found: Refined | None = None
    none = np.zeros((len(start), len(start)))
    for _ in range(IN_TURN):
        theta = start if found is None else found.optimum.theta
        try:
            forces = find_forces(scaled.model(theta), seen, None if found is None else found.forces)
            given = scaled.passed(np.zeros(len(theta)), seen, forces)
            optimum = gauss_newton(partial(scaled.passed, seen=seen, forces=forces), theta, scaled.unit)
        except OutOfTimeError:
            if found is None:
                raise
            return replace(found, optimum=replace(found.optimum, in_time=False))
        except (CovarianceError, np.linalg.LinAlgError):
            return found
        if not np.isfinite(optimum.log_posterior):
            return found
        found = Refined(optimum, given, forces, none)
    return found


def _centred(scaled: Scaled, seen: Recorded, found: Refined) -> Refined:
    """A step against the mean of the score; without time or a finite state for that, what was found."""
    optimum, forces = found.optimum, found.forces
    network = scaled.model(optimum.theta)
    try:
        moments = score_moments(network, scaled.prior(network), seen, forces)
        theta = optimum.theta - np.linalg.solve(optimum.precision, moments.mean)
        last = scaled.passed(theta, seen, forces)
    except OutOfTimeError:
        return replace(found, optimum=replace(optimum, in_time=False))
    except (CovarianceError, np.linalg.LinAlgError):
        return found
    if not np.isfinite(last.log_likelihood):
        return found
    centred = _less_mean(last, moments.mean, theta - optimum.theta)
    return Refined(
        replace(optimum, theta=theta, found=centred, passes=optimum.passes + 1),
        _less_mean(found.given, moments.mean, -optimum.theta),
        forces,
        moments.mean_cov,
    )


def _less_mean(found: Pass, mean: Floats, away: Floats) -> Pass:
    """A pass less the mean of its score, so far away from where that was found, (n,)."""
    if not len(found.scores):
        return found
    return replace(
        found,
        scores=found.scores - mean / len(found.scores),
        log_likelihood=found.log_likelihood - float(mean @ away),
    )
