"""Parts of the tissue that marks leave on either side of the line between them: elbows to the left or to the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics import MassSpringNetwork, all_positions, elbow_parts, mirror_through, potential_energy
from estimators.arrays import Floats
from estimators.filters.mixture import InteractingMixture

BIMODAL = 4.0
"""Squared distance between two equal normal distributions, by their variance, up to which their sum has one maximum."""


@dataclass(frozen=True, slots=True, eq=False)
class Elbow:
    """Free nodes without marks whose springs end at as many other nodes as the tissue has dimensions.

    The mirror through these ends changes no length: only weight and motion tell the two sides apart.
    part, ends: places among all nodes, (n_part,), (dim,); rows: of the part's positions in the state, (n_part, dim)
    """

    part: NDArray[np.intp]
    ends: NDArray[np.intp]
    rows: NDArray[np.intp]


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
        found.append(Elbow(part, ends, free[:, None] * network.dim + np.arange(network.dim)))
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


def _is_barred(network: MassSpringNetwork, mean: Floats, other: Floats) -> bool:
    """Whether the middle between two states has more potential energy than either."""
    half = network.n_state // 2
    here, between, there = (
        potential_energy(network, all_positions(network, x[:half].reshape(-1, network.dim)))
        for x in (mean, 0.5 * (mean + other), other)
    )
    return bool(between > max(here, there))
