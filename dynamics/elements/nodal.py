"""Force elements with one node: the node's weight, and the resistance of the ground to its motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dynamics.arrays import Floats
from dynamics.forces.kernels import (
    KINDS,
    OF_SPRINGS,
    NodeConstants,
    node_resistance,
    resistance_by_log_constants,
    resistance_by_square,
)
from dynamics.network.mass_spring import MassSpringNetwork


class Weight:
    """Weights of nodes as force elements; nodes: index of each node, (n, 1); weight: its weight [N], (n, dim)."""

    def __init__(self, nodes: NDArray[np.int64], weight: Floats) -> None:
        self.nodes, self.weight = nodes, weight

    @classmethod
    def of_network(cls, network: MassSpringNetwork) -> Weight:
        """Weight of all free nodes of a network."""
        return cls(network.free[:, None], network.masses[network.free, None] * network.gravity)

    def energy(self, x: Floats) -> Floats:
        """Gravitational potential energy [J], (n,)."""
        return -np.einsum("nd,nd->n", self.weight, x[:, 0])

    def force(self, x: Floats, v: Floats) -> Floats:
        """Weight [N], (n, 1, dim)."""
        return self.weight[:, None]

    def tangents(self, x: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Zeros, (n, 1, dim, 1, dim) each: weight depends neither on position nor on velocity."""
        n, dim = self.weight.shape
        none = np.zeros((n, 1, dim, 1, dim))
        return none, none

    def by_log_constants(self, x: Floats, v: Floats) -> Mapping[str, Floats]:
        """An empty mapping, because masses are not estimated."""
        return {}


class Resistance:
    """Viscous drag and dry friction against the ground, as force elements.

    nodes: index of the node of each element, (n, 1); constants: drag [N s/m] and friction [N], (n,) each
    """

    def __init__(self, nodes: NDArray[np.int64], constants: NodeConstants) -> None:
        self.nodes, self.constants = nodes, constants

    @classmethod
    def of_network(cls, network: MassSpringNetwork) -> Resistance:
        """Resistance of all free nodes of a network."""
        drag, friction = network.drag[network.free], network.friction[network.free]
        return cls(network.free[:, None], NodeConstants(drag, friction))

    def energy(self, x: Floats) -> Floats:
        """Zeros [J], (n,): resistance stores no energy."""
        return np.zeros(len(x))

    def force(self, x: Floats, v: Floats) -> Floats:
        """Resistance [N], (n, 1, dim)."""
        return -self._resistance(v)[:, None, None] * v

    def tangents(self, x: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Stiffness, which is zero, and damping [N s/m], (n, 1, dim, 1, dim) each."""
        n, _, dim = v.shape
        speed = v[:, 0]
        square = np.einsum("nd,nd->n", speed, speed)
        by_square = resistance_by_square(square, self.constants)
        by_velocity = self._resistance(v)[:, None, None] * np.eye(dim)
        by_velocity = by_velocity + 2.0 * by_square[:, None, None] * speed[:, :, None] * speed[:, None, :]
        return np.zeros((n, 1, dim, 1, dim)), by_velocity[:, None, :, None, :]

    def by_log_constants(self, x: Floats, v: Floats) -> Mapping[str, Floats]:
        """Derivatives of the force with respect to the logarithms of drag and friction [N], (n, 1, dim) each."""
        by = resistance_by_log_constants(np.einsum("nkd,nkd->n", v, v), self.constants)
        kinds = [kind for kind in KINDS if kind not in OF_SPRINGS]
        return {kind: -np.asarray(getattr(by, kind))[:, None, None] * v for kind in kinds}

    def _resistance(self, v: Floats) -> Floats:
        return np.asarray(node_resistance(np.einsum("nkd,nkd->n", v, v), self.constants))
