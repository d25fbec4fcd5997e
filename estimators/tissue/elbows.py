"""Parts of the tissue that marks leave on either side of the line between them: elbows to the left or to the right.

An elbow of several links has more than two sides: it turns within itself while its ends are where the marks hold them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork, all_positions, elbow_parts, mirror_through, potential_energy
from estimators.arrays import Floats
from estimators.filters.branches import Belief, merge_alike, prune
from estimators.filters.mixture import InteractingMixture
from estimators.process.mechanism import angle_between, turned, turnings
from estimators.process.process_model import TissueModel
from estimators.tissue.settings import FilterSettings

BIMODAL = 4.0
"""Squared distance between two equal normal distributions, by their variance, up to which their sum has one maximum."""

APART_RAD = 0.3
"""Between neighbouring shapes of an elbow some link turns by this [rad]; choice: motion is linear within half of it."""

NEAR = 0.7
"""Shapes nearer than this share of `APART_RAD` are one [1]; numerical."""

SPREAD_RAD = 0.6 * APART_RAD
"""Standard deviation of such a shape, so that neighbours overlap [rad]; choice."""

SHAPES = 16
"""Shapes of an elbow that are followed at most; choice: each costs as much as a filter of its own."""

UNEXPECTED = 0.5
"""Probability of a poke from which on links about an elbow may as well be in another shape [1]; choice: at
0.1 a frame takes a fifth longer and a tenth fewer are TRACKING, and about as few of them are wrong."""

KNOWN_RAD = 0.1
"""Standard deviation of the direction of an elbow's links from which on it is not TRACKING [rad]; choice: of 6,400
frames of three links 25 were wrong, and one of them was of the four in five where they are known better."""

REPORTED_RAD = 0.14
"""The same by covariances as they are reported, with their inflation [rad]; choice: of 36,000 frames of three links
four were wrong, all of one swing past the other side, with it none; it costs a sixth of the frames."""

FEW = 4
"""Branches up to which others may begin beside them, and which are few enough to say where the tissue is; choice: it
bounds the time of a frame, and of 50 frames that were wrong 46 had more, of those that were not one in fourteen."""


@dataclass(frozen=True, slots=True, eq=False)
class Elbow:
    """Free nodes without marks whose springs end at as many other nodes as the tissue has dimensions.

    The mirror through these ends changes no length: only weight and motion tell the two sides apart.
    part, ends: places among all nodes, (n_part,), (dim,); rows: of the part's positions in the state, (n_part, dim)
    shortest_m: of its links [m]
    turns: whether it has fewer springs than coordinates, and so turns within itself
    """

    part: NDArray[np.intp]
    ends: NDArray[np.intp]
    rows: NDArray[np.intp]
    turns: bool
    shortest_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Mirror:
    """The line, in space the plane, through an elbow's ends, and how far its other side is.

    rows, speeds: of the elbow's positions and velocities in the state, (n_part, dim)
    middle: a point of it [m], (dim,); normal (dim,)
    squared_distance: between the two places of the node that goes furthest, by the variance of its way
    """

    rows: NDArray[np.intp]
    speeds: NDArray[np.intp]
    middle: Floats
    normal: Floats
    squared_distance: float

    def turned(self, belief: tuple[Floats, Floats, Floats]) -> tuple[Floats, Floats, Floats]:
        """A belief, mean (n,), cov (n, n) and columns (n, r), with the elbow on the other side.

        Positions are mirrored, velocities in its direction.
        """
        mean, cov, columns = belief
        turn, shift = np.eye(len(mean)), np.zeros(len(mean))
        for place in (*self.rows, *self.speeds):
            turn[np.ix_(place, place)] -= 2.0 * np.outer(self.normal, self.normal)
        shift[self.rows] = 2.0 * (self.middle @ self.normal) * self.normal
        return turn @ mean + shift, turn @ cov @ turn.T, turn @ columns


def find_elbows(network: MassSpringNetwork, marked: Sequence[str]) -> tuple[Elbow, ...]:
    """The elbows that the marks of these nodes leave."""
    fixed = network.fixed.copy()
    fixed[[network.index(node) for node in marked]] = True
    found = []
    for part, ends in elbow_parts(network, fixed):
        free = np.searchsorted(network.free, part)
        rows = free[:, None] * network.dim + np.arange(network.dim)
        own = np.isin(network.springs, part).any(axis=1)
        found.append(Elbow(part, ends, rows, int(own.sum()) < rows.size, float(network.rest_lengths[own].min())))
    return tuple(found)


def mirror_at(network: MassSpringNetwork, elbow: Elbow, mean: Floats, considered: Floats) -> Mirror:
    """The mirror through the ends of an elbow, where they are in a state (n,).

    considered: the state's covariance with what the columns add, by which distances count, (n, n)
    """
    positions = all_positions(network, mean[: network.n_state // 2].reshape(-1, network.dim))
    middle, normal = mirror_through(positions[elbow.ends])
    offsets = (positions[elbow.part] - middle) @ normal
    furthest = int(np.abs(offsets).argmax())
    own = elbow.rows[furthest]
    variance = float(normal @ considered[np.ix_(own, own)] @ normal)
    speeds = elbow.rows + network.n_state // 2
    return Mirror(elbow.rows, speeds, middle, normal, 4.0 * float(offsets[furthest]) ** 2 / variance)


def branch_at_elbows(
    mixture: InteractingMixture, network: MassSpringNetwork, elbows: Sequence[Elbow], gate: float
) -> bool:
    """Follow an elbow on both sides from now on, where the other side is possible too; whether there is one.

    As where links pass each other stretched: there one belief covers both sides, beyond it would have to choose. The
    odds of the other side are its density by that belief; it is possible up to this squared distance. Where the way
    there costs no energy, as between nodes that pull, the belief covers it already. Two sides are followed at most.
    """
    if mixture.n_branches > 1:
        return False
    for elbow in elbows:
        mirror = mirror_at(network, elbow, mixture.x, mixture.P)
        if not BIMODAL < mirror.squared_distance < gate:
            continue
        columns = mixture.mean_columns
        own = (mixture.x, mixture.P - columns @ columns.T, columns)
        other = mirror.turned(own)
        if _is_barred(network, mixture.x, other[0]):
            mixture.branch([own, other], np.array([1.0, np.exp(-0.5 * mirror.squared_distance)]))
            return True
    return False


def decide_at_elbows(
    belief: tuple[InteractingMixture, TissueModel, FilterSettings], elbows: Sequence[Elbow], inflation: float
) -> bool:
    """Give up sides that the marks have decided against, merge those that became one, and see whether there are new.

    Whether `FEW` are left, the links of each elbow are known to `KNOWN_RAD`, and to `REPORTED_RAD` by covariances with
    the inflation [1] with which they are reported.
    """
    mixture, model, settings = belief
    prune(mixture, settings.least_odds)
    merge_alike(mixture)
    branch_at_elbows(mixture, model.network, elbows, settings.gate)
    if not elbows:
        return mixture.n_branches <= FEW
    known = _spread(mixture.P, elbows) < min(KNOWN_RAD, REPORTED_RAD / inflation**0.5)
    return mixture.n_branches <= FEW and known


def _spread(cov: Floats, elbows: Sequence[Elbow]) -> float:
    """The most by which a node of an elbow may be off, a standard deviation by the shortest of its links [1]."""
    return max(
        float(np.linalg.eigvalsh(cov[np.ix_(own, own)])[-1]) ** 0.5 / elbow.shortest_m
        for elbow in elbows
        for own in elbow.rows
    )


def may_turn(mixture: InteractingMixture, network: MassSpringNetwork, elbows: Sequence[Elbow], gate: float) -> bool:
    """Whether an elbow may be on its other side by the next marks, up to this squared distance; as predicted."""
    if mixture.n_branches > 1 or mixture.move.linear is None:
        return False
    return any(mirror_at(network, elbow, mixture.x, mixture.P).squared_distance < gate for elbow in elbows)


def may_be_otherwise(
    mixture: InteractingMixture, elbows: Sequence[Elbow], settings: FilterSettings, *, over: bool = False
) -> bool:
    """Whether links about an elbow may be in another shape than any of the few that are followed.

    As where forces that nobody expects explain their marks, or where it may have turned `over` since the frame before
    and is followed on one side.
    """
    if mixture.n_branches > FEW or not elbows or mixture.move.linear is None:
        return False
    return (over and mixture.n_branches == 1) or settings.poked_share(mixture.mu) > UNEXPECTED


def _is_barred(network: MassSpringNetwork, mean: Floats, other: Floats) -> bool:
    """Whether the middle between two states has more potential energy than either."""
    half = network.n_state // 2
    here, between, there = (
        potential_energy(network, all_positions(network, x[:half].reshape(-1, network.dim)))
        for x in (mean, 0.5 * (mean + other), other)
    )
    return bool(between > max(here, there))


def turned_shapes(
    network: MassSpringNetwork, elbow: Elbow, beliefs: Sequence[Belief], *, velocity: float, least: float
) -> tuple[list[Belief], Floats]:
    """Beliefs of an elbow in all shapes to which it turns while its ends and the lengths of its links stay; their odds.

    beliefs: in the shapes to begin with, mean (n,), cov (n, n), columns (n, r) each
    velocity: of the part, its energy E0 [m/s]; odds are exp(-E / E0), E the potential energy, those below `least` of
    the most are left out, and so are the least probable beyond `SHAPES`. Within itself each shape is known to
    `SPREAD_RAD`.
    """
    half, order = network.n_state // 2, count()
    unseen = 0.5 * float(network.masses[elbow.part].sum()) * velocity**2
    rows = elbow.rows.ravel()
    found: list[tuple[float, Belief]] = []
    queue: list[tuple[float, int, Belief]] = []

    def consider(belief: Belief) -> None:
        positions = all_positions(network, belief[0][:half].reshape(-1, network.dim))
        heappush(queue, (potential_energy(network, positions) / unseen, next(order), belief))

    for belief in beliefs:
        consider(belief)
    lowest = queue[0][0]
    while queue and len(found) < SHAPES:
        energy, _, belief = heappop(queue)
        if lowest - energy < np.log(least):
            break
        if any(angle_between(network, belief[0], other[0]) < NEAR * APART_RAD for _, other in found):
            continue
        ways = turnings(network, rows, belief[0])
        found.append((energy, _known_to(belief, ways, SPREAD_RAD)))
        for way in ways:
            for angle in (APART_RAD, -APART_RAD):
                consider(turned(network, rows, belief, angle * way))
    energies = np.array([energy for energy, _ in found])
    return [belief for _, belief in found], np.exp(lowest - energies)


def _known_to(belief: Belief, ways: Floats, spread: float) -> Belief:
    """The belief with this standard deviation along each of these ways, (k, n), by their lengths [1]."""
    mean, cov, columns = belief
    for way in ways:
        along = way / (way @ way)
        variance, wanted = float(along @ cov @ along), spread**2
        if variance > wanted:
            gain = cov @ along / variance
            cov = cov - np.outer(gain, gain) * (variance - wanted)
        else:
            cov = cov + np.outer(way, way) * (wanted - variance)
    return mean, 0.5 * (cov + cov.T), columns
