"""The first state of a filter, its restart from the marks of one frame, and inflation after a divergence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynamics import (
    MassSpringNetwork,
    NetworkError,
    equilibrium_with_fixed,
    pack,
    reaches,
    rest_shape,
    stiffness_matrix,
)
from estimators.arrays import Floats
from estimators.filters.exponential import small_expm
from estimators.filters.mixture import InteractingMixture
from estimators.process.linear_motion import LinearisedTissue, is_linearised
from estimators.process.process_model import TissueModel, accumulated_noise
from estimators.tissue.estimate import MarkMeasurement
from estimators.tissue.settings import FilterSettings
from estimators.tissue.update import StackedMarks

LONG_RUN = 50.0
"""Longest stays in a mode after which the odds are those of the long run: exp(-50) is rounding."""


def restart_from_shape(
    mixture: InteractingMixture, model: TissueModel, settings: FilterSettings, shape: Floats
) -> None:
    """Set all modes to rest in a shape of all nodes [m], (n_nodes, dim), as uncertain as pokes for lost_s make it.

    Slow states stay as they are: they are not the tissue's.
    """
    slow = mixture.x[model.slow], mixture.P[model.slow, model.slow]
    mixture.restart(*_at_rest(model, settings, shape, slow), model.resting_columns(shape))


def _at_rest(
    model: TissueModel, settings: FilterSettings, shape: Floats, slow: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Mean (dim_x,) and covariance (dim_x, dim_x) of a start at rest in this shape, the slow states as given."""
    network = model.network
    mean = np.zeros(model.dim_x)
    mean[: network.n_state] = pack(shape[network.free], np.zeros_like(shape[network.free]))
    if is_linearised(model):
        cov = LinearisedTissue(model).noise_after(mean, settings.poked, settings.lost_s)
    else:
        cov = accumulated_noise(*model.linearised(shape, settings.poked), settings.lost_s)
    mean[model.slow], cov[model.slow, model.slow] = slow
    return mean, within_reach(cov, network)


def forget(
    mixture: InteractingMixture, model: TissueModel, settings: FilterSettings, rest: Floats, *, seconds: float
) -> None:
    """Set all modes to a start at rest, (n_nodes, dim), so many seconds later; odds and the slow states go on.

    Of these alone something is left after a gap that the tissue has no memory of. They follow their chain of modes and
    their first-order process in closed form, however long the gap.
    """
    slowest_s = 1.0 / np.abs(np.diag(settings.rates)).min()
    odds = mixture.chain.odds @ small_expm(settings.rates * min(seconds, LONG_RUN * slowest_s))
    restart_from_shape(mixture, model, settings, rest)
    if len(model.slow_sd):
        left, added = model.slow_step(seconds)
        start, own = mixture.filters[0], model.slow
        x, P = start.x.copy(), start.P.copy()
        x[own] *= left
        P[own, own] = left[:, None] * P[own, own] * left + np.diag(added)
        mixture.restart(x, P, mixture.columns[0])
    mixture.chain.odds = odds / odds.sum()
    mixture.repairs["forgotten"] += 1


def restart_from_marks(
    mixture: InteractingMixture,
    model: TissueModel,
    settings: FilterSettings,
    marks: Sequence[MarkMeasurement],
    *,
    stacked: StackedMarks,
    unseen_s: float | None = None,
) -> None:
    """Set every mode to the tissue at rest with its marked nodes fixed where they are seen.

    Where it has no such rest: at rest without them, then updated by them. Far from its rest shape a Kalman update would
    go along straight lines where the tissue turns. The shape in which it rests with the marked nodes fixed at z is a
    nonlinear estimate with the gain G = d(shape)/dz; its error is (I - G H) times that of the start, less G times that
    of the marks, and so are its covariance (Joseph's form) and columns.
    unseen_s: time of unseen pokes that makes the start uncertain [s]; None: lost_s
    """
    network, places = model.network, {mark.node: mark.position for mark in marks}
    try:
        shape = equilibrium_with_fixed(network, places)
    except NetworkError:
        restart_from_shape(mixture, model, settings, rest_shape(network))
        mixture.update_linear(stacked.z, stacked.H(model.dim_x), stacked.R, stacked.shared)
        return
    own = settings if unseen_s is None else replace(settings, lost_s=unseen_s)
    slow = mixture.x[model.slow], mixture.P[model.slow, model.slow]
    held = _held(model, own, shape, stacked=stacked, slow=slow)
    mixture.restart(*held)


def _held(
    model: TissueModel,
    settings: FilterSettings,
    shape: Floats,
    *,
    stacked: StackedMarks,
    slow: tuple[Floats, Floats],
) -> tuple[Floats, Floats, Floats]:
    """Mean, covariance and columns of the tissue at rest in a shape in which marks hold it."""
    network, rows = model.network, stacked.rows
    mean, cov = _at_rest(model, settings, shape, slow)
    K = stiffness_matrix(network, shape)
    others = [i for i in range(len(K)) if i not in set(rows)]
    G = np.zeros((model.dim_x, len(rows)))
    G[rows, range(len(rows))] = 1.0
    G[others] = -np.linalg.solve(K[np.ix_(others, others)], K[np.ix_(others, rows)])
    keep = np.eye(model.dim_x)
    keep[:, rows] -= G
    P = within_reach(keep @ cov @ keep.T + G @ stacked.R @ G.T, network)
    P[model.slow, model.slow] = slow[1]
    columns = model.resting_columns(shape, rows)
    if stacked.shared is not None:
        columns -= G @ stacked.shared
    return mean, 0.5 * (P + P.T), columns


def after_divergence(
    belief: tuple[InteractingMixture, TissueModel, FilterSettings],
    marks: Sequence[MarkMeasurement],
    stacked: StackedMarks,
    *,
    linear: bool,
    again: bool,
    start_cov: Floats,
) -> None:
    """Inflate the state by start_cov (dim_x, dim_x) after a divergence; restart from the marks after another one.

    The first may have come of an impulse: the tissue is about where it was estimated. After the second nothing is kept
    but that the tissue rests as the marks hold it; of a stiff or large body, whose motion is linear, always, for
    straight lines to far marks would stretch links.
    """
    mixture, model, settings = belief
    if linear:
        unseen_s = settings.confirm_s  # it was seen a frame ago
        restart_from_marks(mixture, model, settings, marks, stacked=stacked, unseen_s=unseen_s)
    elif again:
        restart_from_marks(mixture, model, settings, marks, stacked=stacked)
    else:
        inflate(mixture, settings.inflation * start_cov, stacked)


def inflate(mixture: InteractingMixture, added_cov: Floats, stacked: StackedMarks) -> None:
    """Add this covariance (dim_x, dim_x) to the state of all modes, then update by the marks that refuted it."""
    mixture.restart(mixture.x, mixture.P + added_cov, mixture.mean_columns)
    mixture.update_linear(stacked.z, stacked.H(len(mixture.x)), stacked.R, stacked.shared)


def within_reach(cov: Floats, network: MassSpringNetwork) -> Floats:
    """The covariance (dim_x, dim_x) of a state that is besides known to lie within the network's reach.

    As after a measurement of each position at its mean, with the variance of a point anywhere in its `reach`; in
    Joseph's form, for a body without anchors may be metres away after lost_s of forces on it.
    """
    half = network.n_state // 2
    reach = np.repeat(reaches(network)[network.free], network.dim)
    anywhere = np.diag(reach**2 / (network.dim + 2))
    gain = np.linalg.solve(cov[:half, :half] + anywhere, cov[:half]).T
    keep = np.eye(len(cov))
    keep[:, :half] -= gain
    bounded = keep @ cov @ keep.T + gain @ anywhere @ gain.T
    return 0.5 * (bounded + bounded.T)
