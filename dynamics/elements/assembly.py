"""Assembly of the forces of all force elements on the free coordinates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dynamics.arrays import Floats
from dynamics.elements.element import ForceElement
from dynamics.elements.nodal import Resistance, Weight
from dynamics.elements.springs import Springs
from dynamics.forces.kernels import NodeConstants, Packed, linearised
from dynamics.network.mass_spring import MassSpringNetwork

COMPILED = (Springs, Weight, Resistance)
"""Kinds of elements for which one compiled kernel computes all forces together."""


class Assembly:
    """Forces of elements on the free coordinates, and their tangent matrices. The coordinates are in node order.

    Parameters
    ----------
    positions : (n_nodes, dim)
        Positions of all nodes [m]. Nodes that are not free stay at these positions.
    free : (n_free,) int
        Indices of the nodes that move.
    elements : sequence of ForceElement
        Elements. Later changes to the constants of springs, weights and resistances have no effect.

    Attributes
    ----------
    n, dim : int
        Number of free coordinates; number of coordinates per node.
    """

    def __init__(self, positions: Floats, free: NDArray[np.int64], elements: Sequence[ForceElement]) -> None:
        self.positions, self.free, self.elements = positions, free, tuple(elements)
        n_nodes, self.dim = positions.shape
        place = np.full(n_nodes, -1)
        place[free] = np.arange(len(free))
        self.n = len(free) * self.dim
        self._entries = [self._of_tangents(place[element.nodes]) for element in self.elements]
        self._place = np.where(place < 0, -1, self.dim * place)
        self._packed = _packed(positions.shape, self.elements)
        self._others = [k for k, element in enumerate(self.elements) if type(element) not in COMPILED]

    @classmethod
    def of_network(cls, network: MassSpringNetwork) -> Assembly:
        """Assembly of the springs, weight and resistance of a network."""
        kinds = (Springs.of_network(network), Weight.of_network(network), Resistance.of_network(network))
        return cls(network.positions, network.free, kinds)

    def energy(self, q: Floats) -> float:
        """Potential energy [J] at free coordinates q [m], (n,)."""
        x, _ = self._all(q, np.zeros(self.n))
        return float(sum(element.energy(x[element.nodes]).sum() for element in self.elements))

    def force(self, q: Floats, v: Floats) -> Floats:
        """Force on the free coordinates [N], (n,), at q [m] and v [m/s], (n,)."""
        total: Floats = linearised(q, v, self.positions, self._place, *self._packed, False)[0]
        return total + self._of_others(q, v) if self._others else total

    def linearised(self, q: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        """Force [N], (n,), and dense matrices of stiffness [N/m] and damping [N s/m], (n, n) each."""
        total, K, C = linearised(q, v, self.positions, self._place, *self._packed, True)
        if not self._others:
            return total, K, C
        x, u = self._all(q, v)
        for k in self._others:
            element, (kept, rows, columns) = self.elements[k], self._entries[k]
            for matrix, blocks in zip((K, C), element.tangents(x[element.nodes], u[element.nodes]), strict=True):
                np.add.at(matrix, (rows, columns), blocks.ravel()[kept])
        return total + self._of_others(q, v), K, C

    def tangents(self, q: Floats, v: Floats) -> tuple[csr_array, csr_array]:
        """Stiffness [N/m] and damping [N s/m], (n, n) each: minus the Jacobians of `force` with respect to q and v."""
        x, u = self._all(q, v)
        values: list[list[Floats]] = [[], []]
        for element, (kept, _, _) in zip(self.elements, self._entries, strict=True):
            for found, blocks in zip(values, element.tangents(x[element.nodes], u[element.nodes]), strict=True):
                found.append(blocks.ravel()[kept])
        rows, columns = (np.concatenate([entry[k] for entry in self._entries]) for k in (1, 2))
        shape = (self.n, self.n)
        return tuple(csr_array((np.concatenate(v), (rows, columns)), shape=shape) for v in values)

    def _of_others(self, q: Floats, v: Floats) -> Floats:
        x, u = self._all(q, v)
        total = np.zeros_like(x)
        for element in (self.elements[k] for k in self._others):
            np.add.at(total, element.nodes, element.force(x[element.nodes], u[element.nodes]))
        return total[self.free].ravel()

    def _all(self, q: Floats, v: Floats) -> tuple[Floats, Floats]:
        x, u = self.positions.copy(), np.zeros_like(self.positions)
        x[self.free], u[self.free] = q.reshape(-1, self.dim), v.reshape(-1, self.dim)
        return x, u

    def _of_tangents(self, place: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Entries of the element matrices between free coordinates: index, and row and column in the assembly."""
        corners, dim = place.shape[1], self.dim
        coordinates = np.where(place[..., None] < 0, -1, dim * place[..., None] + np.arange(dim))
        shape = (len(place), corners, dim, corners, dim)
        rows = np.broadcast_to(coordinates[:, :, :, None, None], shape).ravel()
        columns = np.broadcast_to(coordinates[:, None, None, :, :], shape).ravel()
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        return kept, rows[kept], columns[kept]


def _packed(shape: tuple[int, ...], elements: Sequence[ForceElement]) -> Packed:
    """Constants of all elements with compiled laws (`COMPILED`). The argument `shape` is (n_nodes, dim)."""
    ends, springs = [np.empty((0, 2), dtype=np.int64)], [np.empty((0, 3))]
    weight, of_nodes = np.zeros(shape), np.zeros((shape[0], len(NodeConstants._fields)))
    for element in elements:
        if type(element) is Springs:
            ends.append(element.nodes)
            springs.append(np.stack(element.constants, axis=1))
        elif type(element) is Weight:
            np.add.at(weight, element.nodes[:, 0], element.weight)
        elif type(element) is Resistance:
            np.add.at(of_nodes, element.nodes[:, 0], np.stack(element.constants, axis=1))
    return Packed(np.concatenate(ends), np.concatenate(springs), of_nodes, weight)
