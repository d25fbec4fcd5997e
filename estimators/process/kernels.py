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


@njit(cache=True, nogil=True)
def with_pokes(F, by_force, same, pokes, sd, slow):  # type: ignore[no-untyped-def]
    """Transition matrices and noise of a step, each (k, dim_x, dim_x), of states of the network, pokes and slow states.

    F, by_force: as `dynamics.Linearised` has them, of each mode or one of all
    same: the first mode with the forces of each, (k,)
    pokes: the coordinate of each, (n_pokes,), its share in the force of the step, and what is left of it, (k, n_pokes)
    sd: of the noise, a constant force in the step, on each free coordinate [N], (k, n / 2), and of each poke at the
        end, (k, n_pokes)
    slow: what is left of each slow state, and the variance that is added to it, (n_slow,) each
    """
    rows, shares, fade = pokes
    white, faded = sd
    left, added = slow
    k, n, n_pokes = len(same), F.shape[1], len(rows)
    dim_x = n + n_pokes + len(left)
    own, noise = np.zeros((k, dim_x, dim_x)), np.zeros((k, dim_x, dim_x))
    # what a standard deviation of the noise on each coordinate and of each poke makes of the network's state
    made = np.empty((n, n // 2 + n_pokes))
    for j in range(k):
        one = j if len(F) > 1 else 0
        for r in range(n):
            for c in range(n):
                own[j, r, c] = F[one, r, c]
            for c in range(n_pokes):
                own[j, r, n + c] = by_force[one, r, rows[c]] * shares[j, c]
        for c in range(n_pokes):
            own[j, n + c, n + c] = fade[j, c]
        for c in range(n + n_pokes, dim_x):
            own[j, c, c] = left[c - n - n_pokes]
        if same[j] < j:
            noise[j] = noise[same[j]]
            continue
        for r in range(n):
            for c in range(n // 2):
                made[r, c] = by_force[one, r, c] * white[j, c]
            for c in range(n_pokes):
                # a poke that began within the step acts for half of it
                made[r, n // 2 + c] = 0.5 * faded[j, c] * own[j, r, n + c]
                noise[j, r, n + c] = noise[j, n + c, r] = made[r, n // 2 + c] * faded[j, c]
        noise[j, :n, :n] = np.dot(made, made.T)
        for c in range(n_pokes):
            noise[j, n + c, n + c] = faded[j, c] ** 2
        for c in range(n + n_pokes, dim_x):
            noise[j, c, c] = added[c - n - n_pokes]
    return own, noise
