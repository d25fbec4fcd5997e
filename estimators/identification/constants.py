"""The constants of a network from a calibration recording in which the hidden mark is seen, too.

Gauss-Newton on the filter's innovations: a filter that takes the constants as exact runs beside the sensitivities of
its error to each of them; its innovations y, of covariance S, are then noise and T theta, T their sensitivity to the
constants, theta the errors of these. Source: [friedland1969]. Unknown pokes are states of the filter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import KINDS, MassSpringNetwork, Parameter, ParameterUncertainty
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget, IdentificationError, OutOfTimeError
from estimators.identification.filter_pass import Frames, Pass, frame_interval, is_linear, pass_through
from estimators.identification.forced.forces import Recorded
from estimators.identification.forced.refined import Scaled, under_forces
from estimators.identification.groups import (
    ConstantGroup,
    constant_groups,
    group_directions,
    group_prior_sd,
    members,
    scale_groups,
    touched,
)
from estimators.identification.residuals import ResidualTest, residual_covariance
from estimators.identification.search import from_starts, gauss_newton, starts
from estimators.identification.stretch import affordable, frame_seconds, liveliest
from estimators.identification.withheld import Withheld, principal_directions, withheld_target
from estimators.tissue.settings import FilterSettings

PRIOR_SD: Mapping[str, float] = dict.fromkeys(KINDS, 0.5) | {"stiffness": 0.3, "rest_length": 0.05}
"""Prior relative standard deviations of the constants by kind; choice, its cost in docs/settings.md."""

START_SPREAD: Mapping[str, float] = dict.fromkeys(KINDS, float(np.log(3.0))) | {"rest_length": 0.1}
"""Starts are within this of the constants given, in logarithms: a third to three times; rest lengths, which are
measured on a picture, to a tenth; choice, its cost in docs/settings.md."""

SCREENED = 100
"""Frames, the liveliest ones in a row, through which all starts are followed; the best goes through all frames. More
cost time, with fewer half a swing of the phantom is left; choice, its cost in docs/settings.md."""

SEARCH_SHARE = 0.85
"""Share of the time for the search; what is left is for the target without its mark, before and after."""

PASSES_A_START = 6
"""Of the filter, as expected for the progress and for how many frames the time allows for."""


@dataclass(frozen=True, slots=True)
class IdentificationSettings:
    """From how many starts constants are searched, and what is kept of their covariance.

    kept: share of the target's variance by uncertain constants that the kept directions explain; choice
    n_starts: points from which the constants are searched, the given ones first; choice
    """

    kept: float = 0.995
    n_starts: int = 4

    def __post_init__(self) -> None:
        if self.n_starts < 1:
            raise ValueError(f"identification n_starts: expected 1 or more, found {self.n_starts}")
        if not 0.0 < self.kept <= 1.0:
            raise ValueError(f"identification kept: expected more than 0, at most 1, found {self.kept}")


@dataclass(frozen=True, slots=True, eq=False)
class IdentificationResult:
    """Constants of a network estimated from a calibration recording, in groups of one factor each.

    network: with the constants found
    groups, change: which, and the log of each group's factor, (n,)
    cov: covariance of these logs, inflated by what the model leaves unexplained, (n, n)
    prior_sd: standard deviations of the logs before, (n,)
    uncertainty: the few directions of it that matter for the target
    passes: of the filter through the recording; converged: whether the last moved the constants by less than noise
    residuals: what is unexplained
    log_likelihood: of the recording's innovations; before, with the constants given
    target_error_m: median error of the target by its mark where that is not used [m]; before; None: not measured
    n_starts, n_agreeing: starts that were followed, and how many of them led to these constants
    n_frames: of the recording that were used
    in_time: False where the time was too short for all frames, starts and passes
    """

    network: MassSpringNetwork
    groups: tuple[ConstantGroup, ...]
    change: Floats
    cov: Floats
    prior_sd: Floats
    uncertainty: ParameterUncertainty
    passes: int
    converged: bool
    residuals: ResidualTest
    log_likelihood: float
    log_likelihood_before: float
    target_error_m: float | None
    target_error_before_m: float | None
    n_starts: int
    n_agreeing: int
    n_frames: int
    in_time: bool

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All constants that were estimated, group by group."""
        return members(self.groups)

    @property
    def sd(self) -> Floats:
        """Standard error of the log of each group's factor, (n,)."""
        return np.sqrt(np.diag(self.cov))

    def identifiable(self) -> tuple[Floats, Floats]:
        """Part of the prior variance left along each direction, worst first, (n,), and the directions, rows (n, n).

        Directions are in the logs of the constants by their prior standard deviations. Where most is left, the
        recording does not identify them: the Fisher information there is below that of the prior.
        """
        left, directions = np.linalg.eigh(self.cov / np.outer(self.prior_sd, self.prior_sd))
        return left[::-1], directions.T[::-1]


def identify_constants(
    network: MassSpringNetwork,
    frames: Frames,
    marked: Sequence[str],
    target: str,
    *,
    prior_sd: Mapping[str, float] = PRIOR_SD,
    spring_groups: Sequence[str] = (),
    settings: FilterSettings | None = None,
    search: IdentificationSettings | None = None,
    budget: Budget | None = None,
    advance: Callable[[float], None] = lambda _share: None,
) -> IdentificationResult:
    """Fit the constants of these kinds, relative and on a log scale, with this prior; masses are taken as given.

    frames: (time [s], marks) in order, the target's among the marks; marked: the nodes that may be poked
    spring_groups: see `constant_groups`; budget: the time that it may take, then the best until then is returned
    `advance` gets the share done. Raises IdentificationError where the target is never seen, where the time is too
    short for anything, and where the constants given fit the recording as well as any that were found.
    """
    if not any(mark.node == target for _, marks in frames for mark in marks):
        raise IdentificationError(f"expected the mark of {target} to be seen, found it in none of {len(frames)} frames")
    first = next(k for k, (_, marks) in enumerate(frames) if marks)
    chosen = IdentificationSettings() if search is None else search
    limit = Budget() if budget is None else budget
    groups = constant_groups(network, tuple(prior_sd), spring_groups)
    calm = replace(FilterSettings() if settings is None else settings, test_sigmas=np.inf)
    dt = frame_interval(frames) if is_linear(network, len(marked)) else 0.0
    sd = group_prior_sd(network, groups, prior_sd, dt)
    problem = _Problem(network, groups, sd, (tuple(marked), target), calm, limit)
    try:
        return _identified(problem, frames[first:], chosen, advance)
    except OutOfTimeError:
        raise IdentificationError(
            f"expected more time, found {limit.seconds:.0f} s: too short to pass some frames through the filter"
        ) from None


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    network: MassSpringNetwork
    groups: tuple[ConstantGroup, ...]
    sd: Floats
    nodes: tuple[tuple[str, ...], str]
    settings: FilterSettings
    budget: Budget

    def model(self, theta: Floats) -> MassSpringNetwork:
        return scale_groups(self.network, self.groups, self.sd * theta)

    def directions(self, model: MassSpringNetwork, rows: Floats) -> ParameterUncertainty:
        """Rows in the logs of the groups' factors, (k, n_groups), as directions of the constants."""
        which = touched(self.groups)
        return ParameterUncertainty(which, rows @ group_directions(model, self.groups, which))

    def at(self, theta: Floats, frames: Frames) -> Pass:
        model = self.model(theta)
        prior = self.directions(model, np.diag(self.sd))
        return pass_through(model, prior, frames, self.nodes, self.settings, self.budget)

    def withheld(self, model: MassSpringNetwork, uncertainty: ParameterUncertainty, frames: Frames) -> Withheld | None:
        """None where there is no time or no finite state."""
        try:
            return withheld_target(model, uncertainty, frames, self.nodes, self.settings, self.budget)
        except (OutOfTimeError, CovarianceError, np.linalg.LinAlgError):
            return None


def _planned(problem: _Problem, frames: Frames, n_starts: int) -> tuple[int, Frames]:
    """How many starts and which frames the time allows for: one start where with all of them few frames are left."""
    frame_s = frame_seconds(lambda some: problem.at(np.zeros(len(problem.groups)), some), frames, problem.budget)
    try:
        starts_s = PASSES_A_START * n_starts * min(SCREENED, len(frames)) * frame_s
        used = affordable(frames, frame_s, PASSES_A_START + 1, problem.budget, reserved_s=starts_s)
    except OutOfTimeError:
        used = frames[:0]
    if len(used) >= min(SCREENED, len(frames)):
        return n_starts, used
    return 1, affordable(frames, frame_s, 2 * PASSES_A_START, problem.budget)


def _identified(
    problem: _Problem, frames: Frames, chosen: IdentificationSettings, advance: Callable[[float], None]
) -> IdentificationResult:
    n, passes = len(problem.groups), 0
    search = replace(problem, budget=problem.budget.part(SEARCH_SHARE))
    n_starts, used = _planned(search, frames, chosen.n_starts)
    expected = PASSES_A_START * (n_starts + 1)

    def note() -> None:
        nonlocal passes
        share = passes / expected
        advance(min(0.99, max(problem.budget.share, share)))
        passes += 1

    def counted(theta: Floats, through: Frames) -> Pass:
        note()
        return search.at(theta, through)

    screened = liveliest(used, SCREENED)
    spread = np.array([START_SPREAD[group.kind] for group in problem.groups]) / problem.sd
    found = from_starts(lambda theta: counted(theta, screened), list(starts(spread, n_starts)), problem.sd)
    first, best = found[0], max(found, key=lambda one: one.log_posterior)
    n_agreeing = sum(best.agrees(one) for one in found)
    before = first.at_start
    if not np.isfinite(best.log_posterior):
        raise IdentificationError("expected constants under which the filter stays finite, found none")
    refined = None
    if not is_linear(problem.network, len(problem.nodes[0])):
        scaled = Scaled(search.model, lambda model: search.directions(model, np.diag(search.sd)), search.sd, note)
        seen = Recorded(used, search.nodes, search.settings, search.budget)
        try:
            refined = under_forces(scaled, seen, best.theta)
        except OutOfTimeError:
            best = replace(best, in_time=False)
    if refined is not None:
        best, before = refined.optimum, refined.given
    elif len(screened) < len(used):
        try:
            before_all = counted(np.zeros(n), used)
            best = gauss_newton(lambda theta: counted(theta, used), best.theta, problem.sd)
            before = before_all
        except OutOfTimeError:
            used = screened
    model = problem.model(best.theta)
    by_prior, residuals = residual_covariance(best.found, np.eye(n))
    if refined is not None:
        reach = np.linalg.inv(best.precision)
        by_prior = by_prior + reach @ refined.mean_cov @ reach
    cov = by_prior * np.outer(problem.sd, problem.sd)
    wide = problem.directions(model, np.asarray(np.linalg.cholesky(cov).T, dtype=np.float64))
    after = problem.withheld(model, wide, used)
    given = problem.directions(problem.network, np.diag(problem.sd))
    given_withheld = problem.withheld(problem.network, given, used)
    advance(1.0)
    return IdentificationResult(
        network=model,
        groups=problem.groups,
        change=problem.sd * best.theta,
        cov=cov,
        prior_sd=problem.sd,
        uncertainty=wide if after is None else principal_directions(wide, after.effect, chosen.kept),
        passes=best.passes,
        converged=best.converged,
        residuals=residuals,
        log_likelihood=best.found.log_likelihood,
        log_likelihood_before=before.log_likelihood,
        target_error_m=None if after is None else after.median_m,
        target_error_before_m=None if given_withheld is None else given_withheld.median_m,
        n_starts=len(found),
        n_agreeing=n_agreeing,
        n_frames=len(used),
        in_time=best.in_time and len(found) == chosen.n_starts and len(used) == len(frames),
    )


def principal_uncertainty(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    marked: Sequence[str],
    target: str,
    settings: FilterSettings | None = None,
    *,
    kept: IdentificationSettings | None = None,
) -> ParameterUncertainty:
    """The few directions of an uncertainty that explain its effect on the target when the target's mark is not seen.

    The same covariance turned to the axes of the target's variance along the frames; the smallest axes, together below
    1 - `kept` of it, are left out.
    """
    share = (IdentificationSettings() if kept is None else kept).kept
    found = withheld_target(network, uncertainty, frames, (marked, target), settings)
    return principal_directions(uncertainty, found.effect, share)
