"""Material coordinates: positions of nodes along the body, which do not depend on how the body is bent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path

from dynamics.arrays import Floats
from dynamics.network.mass_spring import MassSpringNetwork

THIN = 1e-2
"""A dimension is omitted if the scatter of the nodes along it is at most this share of the largest scatter; choice."""


def path_lengths(network: MassSpringNetwork, lengths: Floats) -> Floats:
    """Length of the shortest path along springs between any two nodes [m], (n, n); inf if there is no path.

    lengths: lengths of the springs [m], (n_springs,)
    """
    n, by_length = network.n_nodes, np.argsort(lengths)
    pairs, first = np.unique(np.sort(network.springs[by_length], axis=1), axis=0, return_index=True)
    graph = csr_array((lengths[by_length][first], (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(shortest_path(graph, directed=False))


def material_coordinates(network: MassSpringNetwork) -> Floats:
    """Coordinates of all nodes in the straightened body [m], (n_nodes, n), with n at most the network's dimension.

    Classical multidimensional scaling [torgerson1952] fits distances between the nodes to path lengths along springs in
    the drawn shape. A cable becomes a straight line (n = 1), even if it is drawn bent.
    """
    i, j = network.springs.T
    ways = path_lengths(network, np.linalg.norm(network.positions[j] - network.positions[i], axis=1))
    apart: NDArray[np.bool_] = ~np.isfinite(ways)
    ways[apart] = ways[~apart].max(initial=0.0)
    centred = ways**2 - (ways**2).mean(axis=0)
    scatter, axes = np.linalg.eigh(-0.5 * (centred - centred.mean(axis=1, keepdims=True)))
    largest = np.argsort(scatter)[::-1][: network.dim]
    kept = [k for k in largest if scatter[k] > THIN * scatter[largest[0]]]
    return np.asarray(axes[:, kept] * np.sqrt(scatter[kept]))
