"""Springs with dashpots, as force elements with two nodes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dynamics.arrays import Floats
from dynamics.forces.kernels import (
    FIELDS,
    OF_SPRINGS,
    SHORTEST,
    SpringConstants,
    spring_potential,
    spring_tension,
    tension_by_length,
    tension_by_log_constants,
    tension_by_rate,
)
from dynamics.network.mass_spring import MassSpringNetwork

ENDS = np.array([-1.0, 1.0])
"""Derivative of the vector from the first to the second node of a spring, with respect to each node's position."""


class Springs:
    """Springs with dashpots as force elements.

    Parameters
    ----------
    nodes : (n_springs, 2) int
    constants : SpringConstants
        Arrays (n_springs,): stiffness [N/m], rest length [m], damping [N s/m].
    """

    def __init__(self, nodes: NDArray[np.int64], constants: SpringConstants) -> None:
        self.nodes, self.constants = nodes, constants

    @classmethod
    def of_network(cls, network: MassSpringNetwork) -> Springs:
        """All springs of a network."""
        return cls(network.springs, SpringConstants(*(getattr(network, FIELDS[kind]) for kind in OF_SPRINGS)))

    def energy(self, x: Floats) -> Floats:
        """Stored energy [J], (n_springs,)."""
        return np.asarray(spring_potential(self._shape(x, np.zeros_like(x))[1], self.constants))

    def force(self, x: Floats, v: Floats) -> Floats:
        """Force on both ends [N], (n_springs, 2, dim)."""
        along, length, rate = self._shape(x, v)
        return _on_ends(spring_tension(length, rate, self.constants), along)

    def tangents(self, x: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Stiffness [N/m] and damping [N s/m] of both ends, (n_springs, 2, dim, 2, dim) each.

        During motion the stiffness is not symmetric, because the rate of a dashpot changes as the spring turns.
        """
        along, length, rate = self._shape(x, v)
        c, dim, turning = self.constants, x.shape[2], (v[:, 1] - v[:, 0]) - rate[:, None] * along
        outer = along[:, :, None] * along[:, None, :]
        tension = spring_tension(length, rate, c)
        slope = np.broadcast_to(tension_by_length(length, rate, c), length.shape)
        damping = np.broadcast_to(tension_by_rate(length, rate, c), length.shape)
        across = np.eye(dim) - outer
        stiffness = slope[:, None, None] * outer + (tension / length)[:, None, None] * across
        stiffness += (damping / length)[:, None, None] * along[:, :, None] * turning[:, None, :]
        pairs = ENDS[:, None] * ENDS
        return tuple(np.einsum("ab,sij->saibj", pairs, block) for block in (stiffness, damping[:, None, None] * outer))

    def by_log_constants(self, x: Floats, v: Floats) -> Mapping[str, Floats]:
        """Derivatives of the force by the logs of stiffness, rest length and damping [N], (n_springs, 2, dim) each."""
        along, length, rate = self._shape(x, v)
        by = tension_by_log_constants(length, rate, self.constants)
        return {kind: _on_ends(getattr(by, kind), along) for kind in OF_SPRINGS}

    def _shape(self, x: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        """For each spring: unit vector from the first end to the second, length [m], and rate of the length [m/s]."""
        apart = x[:, 1] - x[:, 0]
        length = np.sqrt((apart * apart).sum(axis=1) + SHORTEST**2)
        along = apart / length[:, None]
        return along, length, np.einsum("sd,sd->s", v[:, 1] - v[:, 0], along)


def _on_ends(tension: Floats, along: Floats) -> Floats:
    return np.asarray(-ENDS[:, None] * (tension[:, None] * along)[:, None, :])
