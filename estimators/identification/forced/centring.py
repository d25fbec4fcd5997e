"""What a likelihood's slope has of expectation at the true constants: by recordings simulated with the constants found.

A filter that takes forces for possible which do not act takes noise of the marks for velocity: dashpots, drag and
friction seem stronger than they are. By how much does not depend on the pokes, but on how little the filter knows of
them, so that simulated recordings with the smoothed pokes of the true one show it. Source: [gourieroux1993].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics import MassSpringNetwork, Stepper
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.filter_pass import Frames
from estimators.identification.forced.forced_filter import Forces
from estimators.identification.forced.forces import smoothed
from estimators.identification.forced.likeliest import STEP
from estimators.identification.forced.recorded import Recorded

SIMULATED = 8
"""Recordings that are simulated: an eighth is added to the variance of the slope, and stated; numerical."""

SIMULATION_SEED = 2
"""Of the noise of simulated recordings: the same recording gives the same constants."""

KNOT_S = 1.0 / 240.0
"""Outside forces of a simulated recording are constant over this time at the longest [s]: that of its steps."""

FARTHEST = 3.0
"""Steps of the differences along a kind, two standard errors, up to which its likelihoods are followed; numerical."""

WITHIN = 0.25, 1.5
"""Of the way to where a parabola is largest, what may be taken; numerical."""


@dataclass(frozen=True, slots=True, eq=False)
class SlopeMoments:
    """Mean of the likelihood's gradient at the true constants, by their prior deviations [1], (n,), and its covariance.

    mean_cov: what simulation leaves uncertain of that mean, (n, n)
    """

    mean: Floats
    mean_cov: Floats


def slope_moments(
    log_likelihoods: Callable[[Sequence[Floats], Recorded], Floats],
    recordings: Sequence[Recorded],
    theta: Floats,
    information: Floats,
    alike: Floats,
) -> SlopeMoments:
    """The gradient's moments over recordings simulated with the constants theta, (n,).

    log_likelihoods: of several points on a recording; information: of the likelihood, (n, n)
    alike: constants of one kind that act on velocities, (n_kinds, n), 0 or 1: by how much the likelihoods of
        simulated recordings are largest elsewhere along each kind is measured, and shared out by the information
    The slope is the one that has as much of an effect by the information given. Raises OutOfTimeError; CovarianceError
    where fewer than two recordings leave likelihoods finite.
    """
    along = np.einsum("ki,ij,kj->k", alike, information + np.eye(len(theta)), alike)
    least = alike.sum(axis=1)  # curvature of the prior
    lengths = STEP / np.sqrt(along)
    slopes, bends = _along(log_likelihoods, recordings, theta, lengths[:, None] * alike)
    slopes, bends = slopes / lengths, bends / lengths**2
    mean = slopes.mean(axis=0)
    # no farther than the differences mean something: dashpots far stronger would take ever shorter steps
    away = np.clip(mean / (np.maximum(bends, 0.0) + least), -FARTHEST * lengths, FARTHEST * lengths)
    beyond, _ = _along(log_likelihoods, recordings, theta, lengths[:, None] * alike, away[:, None] * alike)
    # a likelihood of dashpots is no parabola: the secant of both slopes, where it leads nearer to where they are nought
    fall = mean - (beyond.mean(axis=0) / lengths - least * away)
    away = away * np.clip(mean / np.where(fall == 0.0, np.inf, fall), *WITHIN)
    weights = alike * np.maximum(np.diag(information), np.finfo(float).tiny)
    shared = (weights / weights.sum(axis=1, keepdims=True)).T
    of_slope = shared * (along / (np.maximum(bends, 0.0) + least))
    cov = np.atleast_2d(np.cov(slopes.T)) / len(slopes)
    return SlopeMoments(shared @ (along * away), of_slope @ cov @ of_slope.T)


def _along(
    log_likelihoods: Callable[[Sequence[Floats], Recorded], Floats],
    recordings: Sequence[Recorded],
    theta: Floats,
    moves: Floats,
    about: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Differences along moves (n_kinds, n) about a point, or about one for each: of recordings with finite likelihoods.

    Slopes by a move, (n_recordings, n_kinds), and the mean of the curvatures about the point itself, (n_kinds,).
    """
    start = theta + (np.zeros_like(moves) if about is None else about)
    slopes: list[Floats] = []
    bends: list[Floats] = []
    for seen in recordings:
        found = log_likelihoods([theta, *(start + moves), *(start - moves)], seen)
        if np.isfinite(found).all():
            middle, (ahead, behind) = found[0], found[1:].reshape(2, -1)
            slopes.append(0.5 * (ahead - behind))
            bends.append(2.0 * middle - ahead - behind)
    if len(slopes) < 2:
        raise CovarianceError(f"simulated recordings: expected two or more of finite likelihood, found {len(slopes)}")
    return np.array(slopes), np.asarray(np.mean(bends, axis=0))


def simulated(network: MassSpringNetwork, seen: Recorded, forces: Forces, n: int = SIMULATED) -> list[Recorded]:
    """So many recordings of the same marks: the smoothed pokes, white noise on every node, noise of the marks.

    Raises OutOfTimeError, CovarianceError.
    """
    rng = np.random.default_rng(SIMULATION_SEED)
    states = _states(network, seen, forces, n, rng)
    return [replace(seen, frames=_marks_of(network, seen.frames, forces.marks, states[:, k], rng)) for k in range(n)]


def _states(network: MassSpringNetwork, seen: Recorded, forces: Forces, n: int, rng: np.random.Generator) -> Floats:
    """Of the network at each frame, (n_frames, n, n_state)."""
    means, _ = smoothed(network, seen, forces)
    dim, half = network.dim, network.n_state // 2
    mass = np.repeat(network.masses[network.free], dim)
    rows = np.concatenate([np.r_[network.coordinates(node)] for node in seen.nodes[0]])
    stepper = Stepper(network, KNOT_S)
    now = np.tile(means[0, : network.n_state], (n, 1))
    states = [now]
    for k in range(1, len(seen.frames)):
        seen.budget.check()
        dt = seen.frames[k][0] - seen.frames[k - 1][0]
        n_steps = stepper.n_steps(dt)
        poked = np.zeros((2, len(rows)))
        for place, _ in forces.at(k):
            own = slice(place * dim, (place + 1) * dim)
            poked[:, own] = means[k - 1 : k + 1, network.n_state :][:, own]
        for step in range(n_steps):
            force = rng.normal(size=(n, half)) * (mass * forces.white / np.sqrt(dt / n_steps))
            share = (step + 0.5) / n_steps
            force[:, rows] += (1.0 - share) * poked[0] + share * poked[1]
            now = stepper.advance(now, dt / n_steps, force)
        states.append(now)
    return np.array(states)


def _marks_of(
    network: MassSpringNetwork, frames: Frames, factor: float, states: Floats, rng: np.random.Generator
) -> Frames:
    """Frames with the marks of these states, (n_frames, n_state), with noise of their covariances."""
    return [
        (
            time_s,
            [
                replace(
                    mark,
                    position=state[network.coordinates(mark.node)]
                    + factor * np.linalg.cholesky(mark.total_cov) @ rng.normal(size=network.dim),
                )
                for mark in marks
            ],
        )
        for (time_s, marks), state in zip(frames, states, strict=True)
    ]
