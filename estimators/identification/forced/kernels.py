"""Compiled frames of many filters at once, each of a network with constants of its own: without Python in between.

Letters as in `estimators.filters.kernels`; (k, ...) is one row for each filter.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dynamics.forces.kernels import Packed, runge_kutta
from estimators.filters.kernels import is_finite, joseph_update, moments, squared_mahalanobis, symmetric_points
from estimators.process.kernels import network_states, with_faded_pokes


@njit(cache=True, nogil=True)
def moved_each(xs, Ps, Qs, n_steps, points_of, pokes, motion, of_springs, of_nodes):  # type: ignore[no-untyped-def]
    """Beliefs n_steps equal steps later: xs (k, dim_x), Ps (k, dim_x, dim_x), which stayed finite, (k,).

    Qs: noise of one step, (k, dim_x, dim_x); points_of: scale of sigma points, their weights Wm, Wc
    pokes: share of each in the force of a step and what is left of it after, both (1, 1, n_pokes), their coordinates
    motion: time of a Runge-Kutta step [s], how many make a step, places of all nodes, the free ones, inverse masses,
        springs, weight; of_springs, of_nodes: constants as `Packed` has them, (k, n_springs, ...), (k, n_nodes, ...)
    """
    scale, Wm, Wc = points_of
    share, fade, poked_rows = pokes
    dt, n_parts, nodes, free, inverse_mass, springs, weight = motion
    n = 2 * len(free) * nodes.shape[1]
    k = len(xs)
    moved_xs, moved_Ps, definite = xs.copy(), Ps.copy(), np.ones(k, dtype=np.bool_)
    for j in range(k):
        p = Packed(springs, of_springs[j], of_nodes[j], weight)
        x, P = xs[j], Ps[j]
        for _ in range(n_steps):
            points, definite[j] = symmetric_points(x, P, scale)
            if not definite[j]:
                break
            each = points.reshape((1, points.shape[0], points.shape[1]))
            states, forces = network_states(each, share, poked_rows, n)
            ahead = runge_kutta(states[0], forces[0], dt, n_parts, nodes, free, inverse_mass, p)
            x, P = moments(with_faded_pokes(ahead, each, fade)[0], Wm, Wc, Qs[j])
        if definite[j] and is_finite(x, P):
            moved_xs[j], moved_Ps[j] = x, P
        else:
            definite[j] = False
    return moved_xs, moved_Ps, definite


@njit(cache=True, nogil=True)
def taken_each(xs, Ps, z, H, R, factors, dim, gate):  # type: ignore[no-untyped-def]
    """Beliefs after marks z (m,) of covariance factor² R: xs, Ps, log likelihoods (k,), -inf where there is none.

    Marks of `dim` coordinates each; those beyond the gate count as uncertain as puts them on it.
    """
    k, m = len(xs), len(z)
    taken_xs, taken_Ps, logs = xs.copy(), Ps.copy(), np.full(k, -np.inf)
    for j in range(k):
        own_R = factors[j] ** 2 * R
        S = H @ Ps[j] @ H.T + own_R
        y = z - H @ xs[j]
        for start in range(0, m, dim):
            part = np.ascontiguousarray(S[start : start + dim, start : start + dim])
            nis = squared_mahalanobis(np.ascontiguousarray(y[start : start + dim]), part)
            if nis > gate:
                own_R[start : start + dim, start : start + dim] += (nis / gate - 1.0) * part
        x, P, _, _, _, nis, log_det, definite = joseph_update(xs[j], Ps[j], z, H, own_R)
        if definite and np.isfinite(nis) and np.isfinite(log_det):
            taken_xs[j], taken_Ps[j] = x, P
            logs[j] = -0.5 * (nis + log_det + m * np.log(2.0 * np.pi))
    return taken_xs, taken_Ps, logs
