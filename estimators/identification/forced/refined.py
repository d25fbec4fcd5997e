"""Constants under the forces of a recording: forces and constants found in turn, then the likelihood's own step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import OutOfTimeError
from estimators.identification.filter_pass import Pass
from estimators.identification.forced.centring import SlopeMoments, simulated, slope_moments
from estimators.identification.forced.forced_filter import Forces
from estimators.identification.forced.forces import find_forces, forced_pass
from estimators.identification.forced.likeliest import likeliest
from estimators.identification.forced.likelihoods import log_likelihoods
from estimators.identification.forced.recorded import Recorded
from estimators.identification.search import Optimum, gauss_newton

IN_TURN = 2
"""Times that forces are found, then constants; numerical: the first time errors of the model pass for pokes."""

OF_A_PASS = 1.0 / 6.0
"""Time of a likelihood, by that of a pass with scores; numerical: for the progress."""

MOST_LOST = 8.0
"""Of the log posterior, by which a centred end may lie below the largest; numerical: four standard errors of one
constant, or one of sixteen."""


@dataclass(frozen=True, slots=True, eq=False)
class Scaled:
    """Constants in prior standard deviations: the network at such a point, its uncertainty there, and the units.

    moved: a point moved by so much, (n,) both, along curves of straight tensions
    alike: which constants that act on velocities are of one kind, (n_kinds, n), 0 or 1
    unit: prior standard deviation of the log of each constant, (n,); note: gets how many passes are about to be made
    """

    model: Callable[[Floats], MassSpringNetwork]
    moved: Callable[[Floats, Floats], Floats]
    prior: Callable[[MassSpringNetwork], ParameterUncertainty]
    alike: Floats
    unit: Floats
    note: Callable[[float], None]

    def passed(self, theta: Floats, seen: Recorded, forces: Forces) -> Pass:
        """The forced filter through the frames at a point."""
        self.note(1.0)
        network = self.model(theta)
        return forced_pass(network, self.prior(network), seen, forces)


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Constants under known forces: where the search ended, the pass with the constants given, under the same forces.

    information: of the likelihood about the end, (n, n); None where it is that of the scores
    slope: its slope's mean, (n,), by simulation, which is taken off the log likelihoods of all points; None: it is not
    mean_cov: what simulation leaves uncertain of that mean, (n, n)
    """

    optimum: Optimum
    given: Pass
    forces: Forces
    information: Floats | None = None
    slope: Floats | None = None
    mean_cov: Floats | None = None

    def less_slope(self, passed: Pass, theta: Floats) -> Pass:
        """A pass at a point, (n,), less the mean slope of its likelihood."""
        return passed if self.slope is None else _less_slope(passed, self.slope, theta)


def under_forces(scaled: Scaled, seen: Recorded, start: Floats) -> Refined | None:
    """The constants that are the most probable under the forces of the recording.

    None where there is no finite state; by scores alone, or not centred, where there is no time for likelihoods, or
    none finite. Raises OutOfTimeError before a first result.
    """
    found = _in_turn(scaled, seen, start)
    return None if found is None else _likeliest(scaled, seen, found)


def _in_turn(scaled: Scaled, seen: Recorded, start: Floats) -> Refined | None:
    """Forces, then constants under them, and so again. Raises OutOfTimeError before the first end."""
    found: Refined | None = None
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
        found = Refined(optimum, given, forces)
    return found


def _likeliest(scaled: Scaled, seen: Recorded, found: Refined) -> Refined:
    """What was found, moved to where the likelihood itself is largest, and its slope centred."""
    forces = found.forces

    def at(points: Sequence[Floats], recorded: Recorded) -> Floats:
        scaled.note(OF_A_PASS * len(points))
        return log_likelihoods([(scaled.model(theta), forces) for theta in points], recorded)

    try:
        start = found.optimum.theta
        best = likeliest(partial(at, recorded=seen), partial(scaled.moved, start), start, found.optimum.precision)
        if best is None:
            return found
        found = _at(scaled, seen, found, best.theta, best.information)
        if not len(scaled.alike):
            return found
        recordings = simulated(scaled.model(best.theta), seen, forces)
        moments = slope_moments(at, recordings, best.theta, best.information, scaled.alike)
        return _centred(scaled, seen, found, best.information, moments)
    except OutOfTimeError:
        return replace(found, optimum=replace(found.optimum, in_time=False))
    except (CovarianceError, np.linalg.LinAlgError):
        return found


def _at(scaled: Scaled, seen: Recorded, found: Refined, theta: Floats, information: Floats) -> Refined:
    """What was found, moved to a point. Raises CovarianceError where there is no finite state."""
    passed = scaled.passed(theta, seen, found.forces)
    if not np.isfinite(passed.log_likelihood):
        raise CovarianceError("likelihood: expected a finite one, found none")
    moved = replace(found.optimum, theta=theta, found=passed, passes=found.optimum.passes + 1)
    return replace(found, optimum=moved, information=information)


def _centred(scaled: Scaled, seen: Recorded, found: Refined, information: Floats, moments: SlopeMoments) -> Refined:
    """What was found, moved to where the likelihood less its mean slope is largest; as it was where that is far off."""
    before = found.optimum.theta
    move = np.asarray(np.linalg.solve(information + np.eye(len(before)), -moments.mean), dtype=np.float64)
    theta = scaled.moved(before, move)
    moved = _at(scaled, seen, found, theta, information)
    if moved.optimum.log_posterior < found.optimum.log_posterior - MOST_LOST:
        return found
    end = replace(moved.optimum, found=_less_slope(moved.optimum.found, moments.mean, theta))
    return replace(moved, optimum=end, slope=moments.mean, mean_cov=moments.mean_cov)


def _less_slope(found: Pass, slope: Floats, away: Floats) -> Pass:
    """A pass less the mean slope of its likelihood, so far away from the constants given, (n,)."""
    return replace(found, log_likelihood=found.log_likelihood - float(slope @ away))
