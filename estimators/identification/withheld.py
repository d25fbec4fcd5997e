"""Marks of a recording that are withheld: how well constants predict them, and which of their errors they show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.budget import Budget
from estimators.identification.filter_pass import (
    Frames,
    Pass,
    failed_pass,
    frame_interval,
    is_linear,
    steps,
)
from estimators.identification.linear_filter import LinearFilter, first_shape
from estimators.process.linear_motion import GRAVITY
from estimators.process.target import target_map
from estimators.tissue.filter import TissueFilter
from estimators.tissue.model import slowest_oscillation
from estimators.tissue.settings import FilterSettings

ELASTIC = 5.0
"""Restoring acceleration by that of gravity above which springs, not weight, hold a body's shape [1]; choice: 1.5 to 35
tell the same bodies of the zoo apart."""


ALL_RESOLVED = 0.0
"""Interval of the frames [s] by which no spring is a rigid link: those of an elastic body hands stretch slowly."""


def is_elastic(network: MassSpringNetwork, n_marked: int) -> bool:
    """Whether a stiff or large network is a body that its weight would bend by less than a fifth of its length.

    What bends it are hands then, and only the ratio of their unknown force to its stiffness shows.
    """
    return is_linear(network, n_marked) and slowest_oscillation(network)[1] > ELASTIC * GRAVITY


def against_hands(settings: FilterSettings, network: MassSpringNetwork) -> FilterSettings:
    """These settings with pokes as strong as hands that bend an elastic body."""
    strong = settings.for_stiff_or_large(slowest_oscillation(network)[1])
    return replace(strong, poked=strong.leading)


def withheld_pass(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    nodes: tuple[Sequence[str], str],
    settings: FilterSettings,
    budget: Budget,
) -> Pass:
    """What the linear filter of the marked nodes' marks tells of all others, whose marks it never takes in.

    The log likelihood is that of each frame by itself: composite. Raises OutOfTimeError.
    """
    marked = nodes[0]
    taken = [(time_s, [mark for mark in marks if mark.node in marked]) for time_s, marks in frames]
    first = next((k for k, (_, seen) in enumerate(taken) if seen), 0)  # from which the filter starts
    n = len(uncertainty.directions)
    information, log_likelihood = np.zeros((n, n)), 0.0
    scores, nis, dof = [], [], []
    try:
        linear = LinearFilter(network, marked, settings, uncertainty, ALL_RESOLVED)
        linear.start(first_shape(network, taken[first][1]), taken[first][1])
        for (dt, seen), (_, marks) in zip(steps(taken[first:]), frames[first + 1 :], strict=True):
            budget.check()
            linear.advance(dt, seen)
            withheld = [mark for mark in marks if mark.node not in marked]
            if withheld:
                one = linear.innovation(withheld)
                log_likelihood += one.log_likelihood
                information += one.T.T @ one.T
                scores.append(one.T.T @ one.y)
                nis.append(float(one.y @ one.y))
                dof.append(float(len(one.y)))
    except (CovarianceError, np.linalg.LinAlgError):
        return failed_pass(n)
    if not np.isfinite(log_likelihood):
        return failed_pass(n)
    told = np.array(scores).reshape(len(scores), n)
    return Pass(told, information, log_likelihood, np.array(nis), np.array(dof), composite=True)


@dataclass(frozen=True, slots=True, eq=False)
class Withheld:
    """The target of frames in which its mark is not used.

    effect: sum of the squared shares of each direction of uncertainty in the target's error [m²], (n, n)
    median_m: median error by its mark [m], None where it has none
    """

    effect: Floats
    median_m: float | None


def withheld_target(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    nodes: tuple[Sequence[str], str],
    settings: FilterSettings | None = None,
    budget: Budget | None = None,
) -> Withheld:
    """What the filter makes of the target without its mark; nodes: those that may be poked, and the target."""
    marked, target = nodes
    limit = Budget() if budget is None else budget
    without = [(time_s, [mark for mark in marks if mark.node != target]) for time_s, marks in frames]
    chosen = FilterSettings() if settings is None else settings
    if is_linear(network, len(marked)):
        followed = _by_linear_filter(network, uncertainty, without, nodes, chosen)
    else:
        followed = _by_tissue_filter(network, uncertainty, without, nodes, chosen)
    n = len(uncertainty.directions)
    effect, errors = np.zeros((n, n)), []
    for (_, marks), (position, columns) in zip(frames, followed, strict=False):
        limit.check()
        effect += columns.T @ columns
        errors += [float(np.linalg.norm(position - mark.position)) for mark in marks if mark.node == target]
    return Withheld(effect, float(np.median(errors)) if errors else None)


def _by_tissue_filter(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    nodes: tuple[Sequence[str], str],
    settings: FilterSettings,
) -> Iterator[tuple[Floats, Floats]]:
    """Position of the target and its columns, frame by frame."""
    tissue = TissueFilter(network, nodes[1], nodes[0], settings, uncertainty=uncertainty)
    n = len(uncertainty.directions)  # the first columns; a strain that the filter considers beside them follows
    for time_s, marks in frames:
        tissue.predict(time_s)
        tissue.update(marks)
        # by the springs alone: a field through the marks would predict it, too, whatever the constants
        yield tissue.target.position(tissue.mixture.x), tissue.target.linear(tissue.mixture.mean_columns[:, :n])


def _by_linear_filter(
    network: MassSpringNetwork,
    uncertainty: ParameterUncertainty,
    frames: Frames,
    nodes: tuple[Sequence[str], str],
    settings: FilterSettings,
) -> Iterator[tuple[Floats, Floats]]:
    """As `_by_tissue_filter`."""
    target = target_map(network, nodes[1])
    frame_s = ALL_RESOLVED if is_elastic(network, len(nodes[0])) else frame_interval(frames)
    linear = LinearFilter(network, nodes[0], settings, uncertainty, frame_s)
    linear.start(first_shape(network, frames[0][1]), frames[0][1])
    yield target.position(linear.x), target.linear(linear.columns)
    for dt, marks in steps(frames):
        linear.advance(dt, marks)
        yield target.position(linear.x), target.linear(linear.columns)


def principal_directions(uncertainty: ParameterUncertainty, effect: Floats, kept: float) -> ParameterUncertainty:
    """An uncertainty turned to the axes of its effect, (n, n), the smallest, below 1 - kept of it, left out."""
    values, axes = np.linalg.eigh(effect)
    values, axes = values[::-1], axes[:, ::-1]
    n_kept = int(np.searchsorted(np.cumsum(values) / values.sum(), kept)) + 1
    return ParameterUncertainty(uncertainty.parameters, axes[:, :n_kept].T @ uncertainty.directions)
