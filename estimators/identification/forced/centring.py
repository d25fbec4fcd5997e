"""What a score has of expectation at the true constants: by recordings that are simulated with the constants found.

Velocities that the filter estimates have errors, and these errors are in the innovations and in their sensitivities to
dashpots, drag and friction alike: the score of these does not vanish on average where the constants are right. How much
is left of it does not depend on the pokes, but on how little the filter knows of them, so that simulated recordings
with the smoothed pokes of the true one show it. Source: [gourieroux1993].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynamics import MassSpringNetwork, ParameterUncertainty, Stepper
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.filter_pass import Frames
from estimators.identification.forced.forced_filter import Forces
from estimators.identification.forced.forces import Recorded, forced_pass, smoothed

SIMULATED = 8
"""Recordings that are simulated: an eighth is added to the variance of the score, and stated; numerical."""

SIMULATION_SEED = 2
"""Of the noise of simulated recordings: the same recording gives the same constants."""

KNOT_S = 1.0 / 240.0
"""Outside forces of a simulated recording are constant over this time at the longest [s]: that of its steps."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoreMoments:
    """Mean of the score at the true constants, by their prior deviations [1], (n,), and its covariance, (n, n)."""

    mean: Floats
    mean_cov: Floats


def score_moments(
    network: MassSpringNetwork, uncertainty: ParameterUncertainty, seen: Recorded, forces: Forces
) -> ScoreMoments:
    """Moments of the score by simulated recordings under these forces.

    Raises OutOfTimeError; CovarianceError where fewer than two of them leave the filter finite, too.
    """
    scores = []
    for frames in simulated(network, seen, forces, SIMULATED):
        found = forced_pass(network, uncertainty, replace(seen, frames=frames), forces)
        if np.isfinite(found.log_likelihood):
            scores.append(found.gradient)
    if len(scores) < 2:
        raise CovarianceError(f"simulated recordings: expected two or more of finite likelihood, found {len(scores)}")
    n = len(uncertainty.directions)
    return ScoreMoments(np.mean(scores, axis=0), np.cov(np.array(scores).T).reshape(n, n) / len(scores))


def simulated(network: MassSpringNetwork, seen: Recorded, forces: Forces, n: int) -> list[Frames]:
    """So many recordings of the same marks: the smoothed pokes, white noise on every node, noise of the marks."""
    rng = np.random.default_rng(SIMULATION_SEED)
    states = _states(network, seen, forces, n, rng)
    return [_marks_of(network, seen.frames, forces.marks, states[:, k], rng) for k in range(n)]


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
