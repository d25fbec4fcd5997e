"""One pass of the filter through a recording: likelihood of its innovations, and their sensitivity to constants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty, stable_step
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget
from estimators.identification.linear_filter import LinearFilter, first_shape
from estimators.tissue.estimate import MarkMeasurement, Status
from estimators.tissue.filter import TissueFilter
from estimators.tissue.settings import FilterSettings

Frames = Sequence[tuple[float, Sequence[MarkMeasurement]]]

LARGEST = 60
"""Length of the state up to which sigma points are passed through: the cost of a pass grows with its cube."""

SHORTEST_STEP = 1.0 / 120.0
"""Stable step [s] below which sigma points of a network scatter off its stiff springs; choice, its cost in
docs/settings.md."""

LEAST_WEIGHT = 1e-6
"""Probability of a mode below which its innovations add nothing: rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """What innovations of a recording contain about errors of the constants, in units of their directions.

    scores: gradient of the log likelihood by each direction, frame by frame, (n_frames, n)
    information: its Fisher information, (n, n); log_likelihood: of all marks, rejected ones as if at the gate
    nis: normalised innovation squared of each frame, (n_frames,); dof: its degrees of freedom, (n_frames,)
    composite: whether the log likelihood is a sum over frames that are not independent of each other
    """

    scores: Floats
    information: Floats
    log_likelihood: float
    nis: Floats
    dof: Floats
    composite: bool = False

    @property
    def gradient(self) -> Floats:
        """Of the log likelihood, (n,)."""
        return np.asarray(self.scores.sum(axis=0))


def failed_pass(n: int) -> Pass:
    """Of constants under which the filter has no finite state: of no likelihood, and without information."""
    return Pass(np.zeros((0, n)), np.zeros((n, n)), -np.inf, np.zeros(0), np.zeros(0))


def pass_through(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    nodes: tuple[Sequence[str], str],
    settings: FilterSettings,
    budget: Budget,
) -> Pass:
    """The filter through the frames, constants taken as exact, beside the sensitivities to each direction.

    nodes: those that may be poked, and the target. Source: [friedland1969]. Raises OutOfTimeError.
    """
    marked, target = nodes
    try:
        if is_linear(network, len(marked)):
            return _linear_pass(network, uncertainty, frames, marked, settings, budget)
        exact = replace(settings, strain_sd=0.0)  # directions are those of the constants that are sought, no others
        return _passed(TissueFilter(network, target, marked, exact, uncertainty=uncertainty), frames, budget)
    except (CovarianceError, np.linalg.LinAlgError):
        return failed_pass(len(uncertainty.directions))


def frame_interval(frames: Frames) -> float:
    """Median time between two frames [s], 0 of a single one."""
    times = [time_s for time_s, _ in frames]
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def with_short_gaps(frames: Frames, longest_s: float) -> Frames:
    """The frames, later by less where longer than this passes between two [s]: an integrator steps through a gap."""
    times = np.array([time_s for time_s, _ in frames])
    shorter = times[:1] + np.r_[0.0, np.cumsum(np.minimum(np.diff(times), longest_s))]
    closed = shorter if np.diff(times).max(initial=0.0) > longest_s else times
    return [(time_s, marks) for time_s, (_, marks) in zip(closed.tolist(), frames, strict=True)]


def is_linear(network: MassSpringNetwork, n_marked: int) -> bool:
    """Whether a network is too large or too stiff for sigma points."""
    large = network.n_state + n_marked * network.dim > LARGEST
    return large or stable_step(network) < SHORTEST_STEP


def _linear_pass(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    marked: Sequence[str],
    settings: FilterSettings,
    budget: Budget,
) -> Pass:
    linear = LinearFilter(network, marked, settings, uncertainty, frame_interval(frames))
    linear.start(first_shape(network, frames[0][1]), frames[0][1])
    n = linear.columns.shape[1]
    information, log_likelihood = np.zeros((n, n)), 0.0
    scores, nis, dof = [], [], []
    for dt, marks in steps(frames):
        budget.check()
        one = linear.advance(dt, marks)
        if one is not None:
            log_likelihood += one.log_likelihood
            information += one.T.T @ one.T
            scores.append(one.T.T @ one.y)
            nis.append(float(one.y @ one.y))
            dof.append(float(len(one.y)))
    return Pass(np.array(scores).reshape(-1, n), information, log_likelihood, np.array(nis), np.array(dof))


def steps(frames: Frames) -> Iterator[tuple[float, Sequence[MarkMeasurement]]]:
    """Time since the frame before [s] and marks of each frame after the first."""
    for (before_s, _), (time_s, marks) in pairwise(frames):
        yield time_s - before_s, marks


def _passed(tissue: TissueFilter, frames: Frames, budget: Budget) -> Pass:
    mixture = tissue.mixture
    mixture.considered = False
    n = tissue.model.n_columns
    information, log_likelihood = np.zeros((n, n)), 0.0
    scores, nis, dof = [], [], []
    for time_s, marks in frames:
        budget.check()
        starting = tissue.seen_s is None or tissue.health.status is Status.LOST
        tissue.predict(time_s)
        starting = starting or tissue.health.status is Status.LOST
        used = tissue.update(marks).marks_used
        if starting:
            continue
        log_likelihood += tissue.log_likelihood
        if not used:
            continue
        score, squared = np.zeros(n), 0.0
        for weight, f, T in zip(mixture.mu, mixture.filters, mixture.innovation_columns, strict=True):
            if weight > LEAST_WEIGHT:
                solved = np.linalg.solve(f.S, np.column_stack([T, f.y]))
                information += weight * T.T @ solved[:, :-1]
                score += weight * T.T @ solved[:, -1]
                squared += weight * float(f.y @ solved[:, -1])
        scores.append(score)
        nis.append(squared)
        dof.append(float(len(mixture.filters[0].y)))
    return Pass(np.array(scores).reshape(-1, n), information, log_likelihood, np.array(nis), np.array(dof))
