"""One pass of the filter through a recording: likelihood of its innovations, and their sensitivity to constants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty, scale_parameters, stable_step
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget
from estimators.identification.linear_filter import filtered, predicted, quasi_static
from estimators.tissue.estimate import MarkMeasurement, Status
from estimators.tissue.filter import TissueFilter
from estimators.tissue.settings import FilterSettings

Frames = Sequence[tuple[float, Sequence[MarkMeasurement]]]

LARGEST = 60
"""Length of the state up to which sigma points are passed through: the cost of a pass grows with its cube."""

SHORTEST_STEP = 1.0 / 120.0
"""Stable step [s] below which sigma points of a network scatter off its stiff springs."""

DIFFERENCE = 1e-4
"""Of a direction, in units of it, by which sensitivities are found: its square is below rounding of their use."""

LEAST_WEIGHT = 1e-6
"""Probability of a mode below which its innovations add nothing: rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """What innovations of a recording contain about errors of the constants, in units of their directions.

    scores: gradient of the log likelihood by each direction, frame by frame, (n_frames, n)
    information: its Fisher information, (n, n); log_likelihood: of all marks, rejected ones as if at the gate
    nis: normalised innovation squared of each frame, (n_frames,); dof: its degrees of freedom, (n_frames,)
    """

    scores: Floats
    information: Floats
    log_likelihood: float
    nis: Floats
    dof: Floats

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
        return _passed(TissueFilter(network, target, marked, settings, uncertainty=uncertainty), frames, budget)
    except (CovarianceError, np.linalg.LinAlgError):
        return failed_pass(len(uncertainty.directions))


def frame_interval(frames: Frames) -> float:
    """Median time between two frames [s], 0 of a single one."""
    times = [time_s for time_s, _ in frames]
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


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
    dt = frame_interval(frames)
    gains = filtered(quasi_static(network, dt), marked, settings, frames, budget)
    base, _ = predicted(quasi_static(network, dt), gains, budget)
    columns = []
    for row in uncertainty.directions:
        changed = scale_parameters(network, uncertainty.parameters, DIFFERENCE * row)
        moved, _ = predicted(quasi_static(changed, dt), gains, budget)
        columns.append([(a - b) / DIFFERENCE for a, b in zip(base, moved, strict=True)])
    n = len(uncertainty.directions)
    information, scores = np.zeros((n, n)), np.zeros((len(base), n))
    for k, y in enumerate(base):
        T = np.column_stack([column[k] for column in columns])
        information += T.T @ T
        scores[k] = T.T @ y
    nis = np.array([float(y @ y) for y in base])
    return Pass(scores, information, gains.log_likelihood, nis, np.array([float(len(y)) for y in base]))


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
        # branches that were made or given up in this frame have no innovations of it
        if not used or len(mixture.filters) != len(mixture.innovation_columns):
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
