"""When, where and how strongly a tissue was poked in a recording, and the noise beside.

A filter in a bank of modes says in which frames somebody poked. How strong the force on each node was in each of these
intervals, and so which nodes were poked, comes of expectation and maximisation: the smoothed forces give the levels by
which they are smoothed again. Source: [shumway1982].
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.arrays import Floats
from estimators.filters.unscented import CovarianceError
from estimators.identification.filter_pass import Pass, failed_pass
from estimators.identification.forced.forced_filter import ForcedFilter, Forces, Poke, Taken, forces_between
from estimators.identification.forced.likelihoods import log_likelihoods
from estimators.identification.forced.recorded import Recorded
from estimators.tissue.filter import TissueFilter

MARGIN = 2
"""Frames before and after those in which the bank of modes sees a poke that belong to it, too: it rises before it is
seen, and falls after; numerical: one more moves the mean score of the phantom's dashpots by 0.01 of its deviation."""

ROUNDS = 3
"""Of expectation and maximisation: the level of a node that nobody poked falls by half in each; numerical."""

STEP, FARTHEST = 0.2, 1.0
"""Of the logarithms of noise levels: for the parabola that gives the most likely ones, and how far it is followed;
numerical: levels and constants are found in turn."""


def forced_pass(network: MassSpringNetwork, uncertainty: ParameterUncertainty, seen: Recorded, forces: Forces) -> Pass:
    """As `pass_through` under known forces. Raises OutOfTimeError."""
    n = len(uncertainty.directions)
    information, log_likelihood = np.zeros((n, n)), 0.0
    scores, nis, dof = [], [], []
    try:
        for one in taken(ForcedFilter(network, seen.nodes[0], seen.settings, uncertainty), seen, forces):
            if one is None:
                continue
            if n:
                solved = np.linalg.solve(one.S, np.column_stack([one.T, one.y]))
                information += one.T.T @ solved[:, :-1]
                scores.append(one.T.T @ solved[:, -1])
            nis.append(one.nis)
            dof.append(float(len(one.y)))
            log_likelihood += one.log_likelihood
    except (CovarianceError, np.linalg.LinAlgError):
        return failed_pass(n)
    return Pass(np.array(scores).reshape(len(scores), n), information, log_likelihood, np.array(nis), np.array(dof))


def taken(forced: ForcedFilter, seen: Recorded, forces: Forces) -> Iterator[Taken | None]:
    """What the filter takes in of each frame after the first, None of one without marks."""
    frames, settings = seen.frames, seen.settings
    quiet = replace(settings.quiet, white=forces.white)
    forced.start(frames[0][1])
    for k in range(1, len(frames)):
        seen.budget.check()
        mode = forces_between(quiet, settings.poked.lasting_s, forces.at(k))
        yield forced.advance(frames[k][0] - frames[k - 1][0], mode, frames[k][1], forces.marks)


def poked_frames(network: MassSpringNetwork, seen: Recorded) -> NDArray[np.bool_]:
    """Frames in which somebody pokes more probably than not, (n_frames,), by the bank of modes.

    Raises OutOfTimeError, CovarianceError.
    """
    exact = replace(seen.settings, strain_sd=0.0, least_white=(0.0, 0.0))
    tissue = TissueFilter(network, seen.nodes[1], seen.nodes[0], exact)
    poked = np.zeros(len(seen.frames), dtype=bool)
    for k, (time_s, marks) in enumerate(seen.frames):
        seen.budget.check()
        tissue.predict(time_s)
        share = tissue.update(marks).poked
        poked[k] = share is not None and share > 0.5
    return poked


def intervals(poked: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last frame of each run of poked frames with its margins; those that meet are one."""
    found: list[tuple[int, int]] = []
    for k in np.flatnonzero(poked):
        first, last = max(1, int(k) - MARGIN), min(len(poked) - 1, int(k) + MARGIN)
        if found and first <= found[-1][1] + 1:
            found[-1] = found[-1][0], last
        else:
            found.append((first, last))
    return found


def smoothed(network: MassSpringNetwork, seen: Recorded, forces: Forces) -> tuple[Floats, Floats]:
    """States of the filter by all marks, (n_frames, dim_x), and variances of the forces on marked nodes [N²].

    By Rauch, Tung and Striebel's smoother [rauch1965]. Raises OutOfTimeError, CovarianceError.
    """
    forced = ForcedFilter(network, seen.nodes[0], seen.settings)
    forced.trace = []
    for _ in taken(forced, seen, forces):
        pass
    last = forced.belief
    if last is None:
        raise CovarianceError("smoothing: expected frames, found none")
    x, P, own = last.x, last.P, forced.model.pokes
    means, variances = [x], [P.diagonal()[own]]
    for moved in forced.trace[::-1]:
        before = moved.before
        G = np.linalg.solve(moved.P, moved.F @ before.P).T
        x = before.x + G @ (x - moved.x)
        P = before.P + G @ (P - moved.P) @ G.T
        means.append(x)
        variances.append(P.diagonal()[own])
    return np.array(means[::-1]), np.array(variances[::-1])


def find_forces(network: MassSpringNetwork, seen: Recorded, before: Forces | None) -> Forces:
    """The forces of a recording, the network taken as exact.

    before: None, or forces whose noise levels are taken to begin with. Raises OutOfTimeError, CovarianceError.
    """
    settings = seen.settings
    runs = intervals(poked_frames(network, seen))
    pokes = tuple(
        Poke(place, first, last, settings.poked.poke) for first, last in runs for place in range(len(seen.nodes[0]))
    )
    forces = Forces(settings.quiet.white, 1.0, pokes) if before is None else replace(before, pokes=pokes)
    for _ in range(ROUNDS if pokes else 0):
        forces = replace(forces, pokes=_with_levels(network, seen, forces))
    return _with_noise(network, seen, forces)


def _with_levels(network: MassSpringNetwork, seen: Recorded, forces: Forces) -> tuple[Poke, ...]:
    """The pokes with the levels that their smoothed forces have, no less than what acts where nobody pokes."""
    means, variances = smoothed(network, seen, forces)
    n_marked, dim = len(seen.nodes[0]), network.dim
    mass = np.array([network.masses[network.index(node)] for node in seen.nodes[0]])
    squares = means[:, network.n_state : network.n_state + n_marked * dim] ** 2 + variances
    by_node = squares.reshape(len(means), n_marked, dim).mean(axis=2) / mass**2
    least = seen.settings.quiet.poke
    # a force of no level is none at the ends of an interval, where it is known to be none
    return tuple(
        replace(poke, level=max(2.0 * least, float(np.sqrt(by_node[poke.first : poke.last, poke.place].mean()))))
        for poke in forces.pokes
    )


def _with_noise(network: MassSpringNetwork, seen: Recorded, forces: Forces) -> Forces:
    """The forces with the white noise and the factor on the marks' noise under which the frames are most likely."""

    def at(places: Sequence[Floats]) -> Floats:
        return log_likelihoods([(network, _scaled(forces, logs)) for logs in places], seen)

    none, axes = np.zeros(2), STEP * np.eye(2)
    middle, *beside = at([none, *-axes, *axes]).tolist()
    logs = none.copy()
    for k, (below, above) in enumerate(zip(beside[:2], beside[2:], strict=True)):
        bend = 2.0 * middle - below - above
        if np.isfinite(bend):
            # where the likelihood does not bend down, as far as it rises
            top = 0.5 * STEP * (above - below) / bend if bend > 0.0 else np.sign(above - below) * FARTHEST
            logs[k] = np.clip(top, -FARTHEST, FARTHEST)
    return _scaled(forces, logs if at([logs])[0] > middle else none)


def _scaled(forces: Forces, logs: Floats) -> Forces:
    return replace(forces, white=float(forces.white * np.exp(logs[0])), marks=float(forces.marks * np.exp(logs[1])))
