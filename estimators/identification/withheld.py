"""The target of a recording without its mark: how well constants predict it, and which of their errors it shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.identification.budget import Budget
from estimators.identification.filter_pass import Frames, is_linear, likeliest_start, steps
from estimators.process.target import target_map
from estimators.tissue.filter import TissueFilter
from estimators.tissue.settings import FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class Withheld:
    """The target of frames in which its mark is not used.

    effect: sum of the squared shares of each direction of uncertainty in the target's error [m²], (n, n)
    median_m: median error by its mark [m], None where it has none: an elbow may be on the wrong side for a while
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
    linear = likeliest_start(network, uncertainty, frames, nodes[0], settings)
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
