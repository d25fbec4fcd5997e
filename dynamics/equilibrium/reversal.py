"""Test for reversed springs, which show that a network is turned inside out."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dynamics.arrays import Floats
from dynamics.network.mass_spring import MassSpringNetwork


def inverted_springs(network: MassSpringNetwork, states: Floats) -> NDArray[np.bool_]:
    """Whether a spring is reversed in any state of a set, compared with the first state of the set, (n_sets,).

    A spring is reversed if it has turned by 90 degrees or more. No linearisation is valid for such a turn.
    states: (n_sets, n_points, n_state or more), positions of the free nodes first [m]
    """
    return _reversed(np.ascontiguousarray(states), network.positions, _first_coordinates(network), network.springs)


@lru_cache(maxsize=64)
def _first_coordinates(network: MassSpringNetwork) -> NDArray[np.intp]:
    """Index of each node's first coordinate among the free coordinates, (n_nodes,); -1 for an anchor."""
    place = np.full(network.n_nodes, -1)
    place[network.free] = np.arange(len(network.free)) * network.dim
    return place


@njit(cache=True, nogil=True)
def _reversed(states, nodes, place, springs):  # type: ignore[no-untyped-def]
    n_sets, n_points, _ = states.shape
    dim = nodes.shape[1]
    found = np.zeros(n_sets, dtype=np.bool_)
    first = np.empty(dim)
    for k in range(n_sets):
        for s in range(springs.shape[0]):
            i, j = springs[s, 0], springs[s, 1]
            a, b = place[i], place[j]
            for q in range(n_points):
                along = 0.0
                for d in range(dim):
                    end = nodes[j, d] if b < 0 else states[k, q, b + d]
                    apart = end - (nodes[i, d] if a < 0 else states[k, q, a + d])
                    if q == 0:
                        first[d] = apart
                    along += apart * first[d]
                if not along > 0.0:
                    found[k] = True
    return found
