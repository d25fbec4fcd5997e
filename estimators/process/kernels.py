"""Compiled copies of sigma points, between the state of the filter and that of the network with the forces on it."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def network_states(points, shares, poked_rows, n):  # type: ignore[no-untyped-def]
    """Of each mode's points (k, q, dim_x) the network's states (k, q, n), and forces on its free coordinates [N].

    shares: of each poke in the force of a step, (k, 1, n_pokes); poked_rows: the coordinate of each, (n_pokes,)
    The forces, (k, q, n / 2), are zero where nothing is poked.
    """
    n_modes, n_points, _ = points.shape
    states = np.empty((n_modes, n_points, n))
    forces = np.zeros((n_modes, n_points, n // 2))
    for k in range(n_modes):
        for q in range(n_points):
            for i in range(n):
                states[k, q, i] = points[k, q, i]
            for r in range(len(poked_rows)):
                forces[k, q, poked_rows[r]] = shares[k, 0, r] * points[k, q, n + r]
    return states, forces


@njit(cache=True, nogil=True)
def with_faded_pokes(states, points, fade):  # type: ignore[no-untyped-def]
    """Points (k, q, dim_x) with these states of the network, (k q, n), and their pokes times `fade`, (k, 1, n_pokes).

    What follows the pokes stays as it is.
    """
    n_modes, n_points, dim_x = points.shape
    n, n_pokes = states.shape[1], fade.shape[2]
    moved = np.empty((n_modes, n_points, dim_x))
    for k in range(n_modes):
        for q in range(n_points):
            for i in range(n):
                moved[k, q, i] = states[k * n_points + q, i]
            for r in range(n_pokes):
                moved[k, q, n + r] = fade[k, 0, r] * points[k, q, n + r]
            for i in range(n + n_pokes, dim_x):
                moved[k, q, i] = points[k, q, i]
    return moved
