"""Search for the most probable constants from several starts: Gauss-Newton with line search and time limit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from estimators.arrays import Floats
from estimators.identification.budget import OutOfTimeError
from estimators.identification.filter_pass import Pass
from estimators.identification.residuals import times_counted

MOST_PASSES = 24
"""Largest number of passes of a search; choice: a search usually takes three to eight, more for a bad start."""

CONVERGED = 0.2
"""A search ends if the next step of each constant is below this number of its standard errors [1]. The remaining
distance adds at most 2 % to the constant's error."""

AGREEING = 1.0
"""Two results agree if each constant differs by less than this number of standard errors."""

LONGEST_STEP = 4.0
"""Largest factor by which a Gauss-Newton step is lengthened [1]; numerical."""

LONGEST_MOVE = 1.0
"""Longest step of the logarithm of a constant: a factor of e. The linear model of a longer step would be invalid."""

START_SEED = 1
"""Seed of the scrambled Sobol sequence of starts. It is fixed, so that a recording always gives the same constants."""

At = Callable[[Floats], Pass]
"""Function that runs a filter pass with given constants; its argument is theta, (n,), as in `Optimum`."""


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """Result of a search; theta: log of the best factor of each group, in prior standard deviations, (n,).

    found, at_start: filter passes with the result and with the starting point; passes: number of passes
    converged: whether the next step is below `CONVERGED`; in_time: False if the time ended during the search
    times: number by which the log likelihood is divided [1], see `times_counted`
    """

    theta: Floats
    found: Pass
    at_start: Pass
    passes: int
    converged: bool
    in_time: bool = True
    times: float = 1.0

    @property
    def log_posterior(self) -> float:
        """Log posterior of theta, up to a constant."""
        return self.at(self.times)

    def at(self, times: float) -> float:
        """Log posterior of theta, up to a constant. The log likelihood is first divided by `times` [1]."""
        return self.found.log_likelihood / times - 0.5 * float(self.theta @ self.theta)

    @property
    def precision(self) -> Floats:
        """Inverse covariance of theta, (n, n): Fisher information divided by `times`, plus the prior's unit matrix."""
        return self.found.information / self.times + np.eye(len(self.theta))

    def agrees(self, other: Optimum) -> bool:
        """Whether each constant differs from its value in `other` by less than `AGREEING` standard errors."""
        sd = np.sqrt(np.diag(np.linalg.inv(self.precision)))
        return bool((np.abs(other.theta - self.theta) < AGREEING * sd).all())


def starts(spread: Floats, n: int) -> Floats:
    """Starting points, (n, n_constants): zeros, then Sobol points from -spread to spread; spread: (n_constants,)."""
    if n == 1:
        return np.zeros((1, len(spread)))
    sobol = qmc.Sobol(len(spread), seed=START_SEED).random_base2(max(0, int(np.ceil(np.log2(n - 1)))))
    return np.vstack([np.zeros(len(spread)), spread * (2.0 * sobol[: n - 1] - 1.0)])


def begun(at: At, start: Floats) -> Optimum:
    """State of a search after the filter pass at its start. Raises OutOfTimeError."""
    first = at(start)
    return Optimum(start, first, first, 1, converged=False, times=times_counted(first))


def most_probable(found: Sequence[Optimum]) -> Optimum:
    """The result with the highest posterior. All log likelihoods are divided by the smallest `Optimum.times` of all."""
    times = min((one.times for one in found if np.isfinite(one.log_posterior)), default=1.0)
    return max(found, key=lambda one: one.at(times))


def gauss_newton(at: At, start: Floats, unit: Floats) -> Optimum:
    """Maximise the posterior from a start. If the time ends during the search, return the best point so far.

    unit: prior standard deviation of the log of each constant, (n,). Raises OutOfTimeError if no pass ends in time.
    """
    return climbed(at, begun(at, start), unit)


def climbed(at: At, best: Optimum, unit: Floats) -> Optimum:
    """Continue a Gauss-Newton search from `best`; unit: prior standard deviation of the log of each constant, (n,)."""
    longest = 1.0
    try:
        while best.passes < MOST_PASSES and np.isfinite(best.log_posterior):
            move = np.linalg.solve(best.precision, best.found.gradient / best.times - best.theta)
            error = np.sqrt(np.diag(np.linalg.inv(best.precision)))
            away = float(np.abs(move / error).max())
            if away < CONVERGED:
                return replace(best, converged=True)
            step = min(longest, LONGEST_MOVE / float(np.abs(move * unit).max()))
            tried = best
            for passes in range(best.passes + 1, MOST_PASSES + 1):
                theta = best.theta + step * move
                tried = replace(best, theta=theta, found=at(theta), passes=passes)
                if tried.log_posterior >= best.log_posterior or step * away < CONVERGED:
                    break
                step *= 0.5
            if tried.log_posterior < best.log_posterior:
                return replace(best, passes=tried.passes, converged=step * away < CONVERGED)
            # scores neglect the effect of constants on gains; if a step improves the posterior twice as much as
            # predicted, it was too short
            is_short = tried.log_posterior - best.log_posterior > float(move @ best.precision @ move)
            longest = min(2.0 * longest, LONGEST_STEP) if is_short else 1.0
            best = replace(tried, times=times_counted(tried.found))
    except OutOfTimeError:
        return replace(best, in_time=False)
    return best


def followed(at: At, start: Floats, unit: Floats) -> Optimum | None:
    """Result of `gauss_newton`; None if the time ends before the first pass."""
    try:
        return gauss_newton(at, start, unit)
    except OutOfTimeError:
        return None


def from_starts(found: Iterable[Optimum | None]) -> list[Optimum]:
    """Results in order of the starts, up to the first search without result. Raises OutOfTimeError if there is none."""
    in_time: list[Optimum] = []
    for optimum in found:
        if optimum is None:
            break
        in_time.append(optimum)
    if not in_time:
        raise OutOfTimeError
    return in_time
