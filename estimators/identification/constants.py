"""Estimation of a network's constants from a calibration recording that also shows the mark of the hidden target.

The estimation is a Gauss-Newton search on the innovations of the marks that the filter does not use. The filter treats
the constants as exact. It also computes the sensitivity `T` of each innovation to the constants. Errors `theta` of the
constants add `T theta` to an innovation. The rest is noise with the innovation covariance. Source: [friedland1969].
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dynamics import KINDS, MassSpringNetwork, Parameter, ParameterUncertainty
from dynamics.threads import one_blas_thread
from estimators.arrays import Floats
from estimators.identification.budget import (
    Budget,
    IdentificationError,
    OutOfTimeError,
    Progress,
    TooShortError,
    Workers,
)
from estimators.identification.determined import keeping_undetermined, left_open
from estimators.identification.filter_pass import Frames, Pass, pass_through
from estimators.identification.forces import with_likely_forces
from estimators.identification.groups import ConstantGroup, constant_groups, members
from estimators.identification.problem import PASSES_A_SEARCH, SCREENED, Problem
from estimators.identification.residuals import ResidualTest, residual_covariance, within_prior
from estimators.identification.search import Optimum, begun, climbed, from_starts, most_probable, starts
from estimators.identification.stretch import from_first_marks, liveliest
from estimators.tissue.settings import FilterSettings

PRIOR_SD: Mapping[str, float] = dict.fromkeys(KINDS, 0.5) | {"stiffness": 0.3, "rest_length": 0.05}
"""Prior relative standard deviations of the constants, by kind; choice."""

START_SPREAD: Mapping[str, float] = dict.fromkeys(KINDS, float(np.log(3.0))) | {"rest_length": 0.1}
"""Largest difference between the log of a constant at a start of the search and the log of its given value, by kind;
choice: a factor of three, but 10 % for rest lengths, because they are measured in a picture."""

START_SDS = 4.0
"""Largest distance of a start from the given constants, in prior standard deviations; choice; see `START_SPREAD`."""


@dataclass(frozen=True, slots=True)
class IdentificationSettings:
    """Settings of the identification.

    kept: the reduced uncertainty has to cause at least this share of the target's variance due to the constants; choice
    n_starts: number of searches from different starts; the first search starts at the given constants; choice
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
    """Constants of a network estimated from a calibration recording. Each group of constants has one factor.

    network: the network with the estimated constants
    groups, change: the groups, and the log of each group's factor, (n,); 0 if the recording does not determine it
    cov: covariance of the logs, (n, n); correlated innovations and several equally good results increase it
    prior_sd: prior standard deviations of the logs, (n,)
    uncertainty: uncertainty of the constants, reduced to the few directions that matter for the target
    passes: number of filter passes; converged: whether the search ended within its tolerance
    residuals: test of the residuals
    log_likelihood, log_likelihood_before: log likelihood with the estimated constants, and with the given constants
    target_error_m, target_error_before_m: median distance between the predicted target and its mark [m], with the
        estimated constants, and with the given constants
    n_starts, n_agreeing: number of starts, and number of starts that led to the estimated constants
    n_frames: number of used frames
    in_time: False if the time did not allow all frames and starts, or if the time ended during the search
    n_limited: number of directions in which the covariance was limited by the prior
    force_strength: estimated strength of the unknown forces, relative to that in the settings [1]; 1 for springs
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
    n_limited: int
    force_strength: float = 1.0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All estimated constants, group by group."""
        return members(self.groups)

    @property
    def sd(self) -> Floats:
        """Standard error of the log of each group's factor, (n,)."""
        return np.sqrt(np.diag(self.cov))

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Whether each group keeps its given values because the recording does not determine them, (n,)."""
        return np.asarray(self.change == 0.0)

    def identifiable(self) -> tuple[Floats, Floats]:
        """Ratios of posterior to prior variance along n directions, (n,), and these directions as rows, (n, n).

        A direction is a combination of the logs of the factors, in prior standard deviations. The largest ratio is
        first. If a ratio is above 0.5, the recording contains less information on the direction than the prior does.
        """
        left, directions = np.linalg.eigh(self.cov / np.outer(self.prior_sd, self.prior_sd))
        return left[::-1], directions.T[::-1]


@one_blas_thread()
def identify_constants(
    network: MassSpringNetwork,
    frames: Frames,
    marked: Sequence[str],
    target: str,
    *,
    prior_sd: Mapping[str, float] = PRIOR_SD,
    rests_as_drawn: bool = False,
    spring_groups: Sequence[str] = (),
    settings: FilterSettings | None = None,
    search: IdentificationSettings | None = None,
    budget: Budget | None = None,
    workers: Workers = map,
    advance: Callable[[float], None] = lambda _share: None,
) -> IdentificationResult:
    """Estimate constants of a network from a recording that contains the target's mark.

    frames: (time [s], marks) in order; marked: nodes whose marks the filter uses, and on which short forces may act
    prior_sd: prior standard deviation of the log of each kind of constant; spring_groups: see `constant_groups`
    rests_as_drawn: see `constant_groups`; budget: time limit
    workers: `map`, or the map function of a pool of processes; advance: called with the completed share of the work
    Raises IdentificationError if the target has no mark or is the only marked node, if the time is too short for any
    result, or if the filter fails numerically from all starts.
    """
    if not any(mark.node == target for _, marks in frames for mark in marks):
        raise IdentificationError(f"expected the mark of {target} in a frame, found it in none of {len(frames)} frames")
    if not set(marked) - {target}:
        raise IdentificationError(f"expected a marked node besides {target}, which is predicted from it, found none")
    limit = Budget() if budget is None else budget
    groups = constant_groups(network, tuple(prior_sd), spring_groups, rests_as_drawn=rests_as_drawn)
    sd = np.array([prior_sd[group.kind] for group in groups])
    problem = Problem(network, groups, sd, (tuple(marked), target), settings or FilterSettings(), limit)
    try:
        return _identified(problem, from_first_marks(frames), search or IdentificationSettings(), workers, advance)
    except OutOfTimeError:
        raise TooShortError(limit) from None


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """Result of the searches from all starts.

    problem: the problem, with the most probable strength of the unknown forces
    before: pass with the constants before the search; n_agreeing: number of starts that led to the best constants
    used: the used frames; left_open: see `determined.left_open`; larger if the last search did not converge, (n, n)
    """

    problem: Problem
    best: Optimum
    before: Pass
    n_starts: int
    n_agreeing: int
    used: Frames
    left_open: Floats


def _searched(
    problem: Problem, frames: Frames, n_starts: int, workers: Workers, advance: Callable[[float], None]
) -> _Found:
    """Search from several starts with a part of the frames, then continue with all frames.

    The second search starts from the best result of the first search, or from the given constants if these are more
    probable with all frames. Raises OutOfTimeError.
    """
    n_starts, used = problem.planned(frames, n_starts)
    screened = liveliest(used, SCREENED)
    progress = Progress(PASSES_A_SEARCH * n_starts * len(screened) + problem.n_passes * len(used), advance)
    problem = with_likely_forces(replace(problem, budget=problem.budget.watched(progress.frame)), used)
    progress.returned = progress.seen

    def counted(optimum: Optimum | None) -> Optimum | None:
        progress.passes(0.0 if optimum is None else optimum.passes * len(screened))
        return optimum

    def of_all(theta: Floats) -> Pass:
        return problem.at(theta, used)

    spread = np.minimum([START_SPREAD[group.kind] for group in problem.groups] / problem.sd, START_SDS)
    found = from_starts(counted(one) for one in workers(partial(problem.followed, screened), starts(spread, n_starts)))
    before, best = found[0].at_start, most_probable(found)
    n_agreeing = sum(best.agrees(one) for one in found)
    if not np.isfinite(best.log_posterior):
        raise IdentificationError("expected constants under which the filter stays finite, found none")
    between = left_open(found, best)
    if len(screened) < len(used):
        try:
            given, there = begun(of_all, np.zeros_like(best.theta)), begun(of_all, best.theta)
            # the best constants for a part of the frames may be worse for all frames than the given constants
            begins = most_probable([there, given])
            best, before = climbed(of_all, begins, problem.sd), given.found
            if not best.converged:
                between = between + np.outer(best.theta - begins.theta, best.theta - begins.theta)
            n_agreeing = sum(best.agrees(one) for one in found) if best.at_start is given.found else n_agreeing
        except OutOfTimeError:
            best, used = replace(best, in_time=False), screened
    return _Found(problem, best, before, len(found), n_agreeing, used, between)


def _identified(
    problem: Problem,
    frames: Frames,
    chosen: IdentificationSettings,
    workers: Workers,
    advance: Callable[[float], None],
) -> IdentificationResult:
    stated = problem.settings
    found = _searched(
        problem,
        frames,
        chosen.n_starts,
        workers,
        lambda share: advance(min(0.99, max(problem.budget.share, share))),
    )
    problem, best, used, after = found.problem, found.best, found.used, found.best.found
    by_prior, residuals = residual_covariance(after)
    left = by_prior + found.left_open
    theta, by_prior, n_limited = keeping_undetermined(best.theta, left)
    if (theta != best.theta).any():
        with suppress(OutOfTimeError):
            as_kept = problem.at(theta, used) if theta.any() else found.before
            if as_kept.log_likelihood < found.before.log_likelihood:
                # with some constants kept, the other constants explain the recording worse than the given constants
                theta, (by_prior, n_limited) = best.theta, within_prior(left, best.theta)
            else:
                after = as_kept
    model = problem.model(theta)
    cov = by_prior * np.outer(problem.sd, problem.sd)
    root = np.asarray(np.linalg.cholesky(by_prior).T, dtype=np.float64)
    advance(1.0)
    return IdentificationResult(
        network=model,
        groups=problem.groups,
        change=problem.sd * theta,
        cov=cov,
        prior_sd=problem.sd,
        uncertainty=_principal(problem.directions(model, root * problem.sd), root @ after.effect @ root.T, chosen.kept),
        passes=best.passes,
        converged=best.converged,
        residuals=residuals,
        log_likelihood=after.log_likelihood,
        log_likelihood_before=found.before.log_likelihood,
        target_error_m=after.target_error_m,
        target_error_before_m=found.before.target_error_m,
        n_starts=found.n_starts,
        n_agreeing=found.n_agreeing,
        n_frames=len(used),
        in_time=best.in_time and found.n_starts == chosen.n_starts and len(used) == len(frames),
        n_limited=n_limited,
        force_strength=problem.settings.poked.poke / stated.poked.poke,
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
    """Reduce an uncertainty to the few directions that explain its effect on the target.

    The directions are the principal axes of the uncertainty's contribution to the target's variance, summed over the
    frames. The largest axes are kept. Together they contribute at least the share `IdentificationSettings.kept`.
    """
    share = (kept or IdentificationSettings()).kept
    nodes = tuple(marked), target
    found = pass_through(network, uncertainty, frames, nodes, settings or FilterSettings(), Budget())
    return _principal(uncertainty, found.effect, share)


def _principal(uncertainty: ParameterUncertainty, effect: Floats, kept: float) -> ParameterUncertainty:
    """Keep the largest principal axes of `effect`, (n, n): the fewest that contain the share `kept` of its trace."""
    values, axes = np.linalg.eigh(effect)
    values, axes = values[::-1], axes[:, ::-1]
    n_kept = int(np.searchsorted(np.cumsum(values), kept * values.sum())) + 1
    return ParameterUncertainty(uncertainty.parameters, axes[:, :n_kept].T @ uncertainty.directions)
