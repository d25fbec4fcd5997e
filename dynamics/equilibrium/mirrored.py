"""Other shapes in which a network rests while some of its nodes are fixed: an elbow to the left or to the right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from dynamics.arrays import Floats
from dynamics.equilibrium.rest import equilibrium_with_fixed
from dynamics.forces.energy import potential_energy
from dynamics.network.mass_spring import MassSpringNetwork, NetworkError

APART = 1e-6
"""Shapes nearer to each other than this share of the network's size are one: a thousand times what rounding leaves."""


def mirrored_shapes(
    network: MassSpringNetwork, places: Mapping[str, ArrayLike], shape: Floats
) -> list[tuple[float, Floats]]:
    """Other equilibria with these nodes fixed: energy beyond that of `shape` [J] and positions [m], (n_nodes, dim).

    shape: an equilibrium with these nodes fixed, (n_nodes, dim) [m]
    Each part whose springs end at as many fixed nodes and anchors as there are dimensions is mirrored, in turn, at the
    line, in space at the plane, through these: that changes no length, and the part comes to rest close by. Parts with
    more ends have braces that tell the sides apart.
    """
    fixed = network.fixed.copy()
    fixed[[network.index(node) for node in places]] = True
    energy, size = potential_energy(network, shape), float(np.ptp(shape, axis=0).max())
    found: list[tuple[float, Floats]] = []
    for part, ends in elbow_parts(network, fixed):
        middle, normal = mirror_through(shape[ends])
        mirrored = shape.copy()
        mirrored[part] -= 2.0 * np.outer((shape[part] - middle) @ normal, normal)
        try:
            other = equilibrium_with_fixed(replace(network, positions=mirrored), places)
        except NetworkError:
            continue
        if all(np.abs(other - known).max() > APART * size for known in (shape, *(each for _, each in found))):
            found.append((potential_energy(network, other) - energy, other))
    return found


def mirror_through(ends: Floats) -> tuple[Floats, Floats]:
    """A point on the mirror through these places [m], (dim, dim), and its unit normal (dim,)."""
    middle = ends.mean(axis=0)
    return middle, np.linalg.svd(ends - middle)[2][-1]


def elbow_parts(
    network: MassSpringNetwork, fixed: NDArray[np.bool_]
) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Nodes of each part whose springs end at as many fixed nodes as there are dimensions, and these ends, (dim,).

    fixed: (n_nodes,)
    """
    a, b = network.springs.T
    inside = ~fixed[a] & ~fixed[b]
    n = network.n_nodes
    joined = csr_array((np.ones(int(inside.sum())), (a[inside], b[inside])), shape=(n, n))
    labels = connected_components(joined, directed=False)[1]
    parts = []
    for label in np.unique(labels[~fixed]):
        own = ~fixed & (labels == label)
        ends = np.union1d(a[fixed[a] & own[b]], b[fixed[b] & own[a]])
        if len(ends) == network.dim:
            parts.append((np.flatnonzero(own), ends))
    return parts
