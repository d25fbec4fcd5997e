"""Posterior Cramér-Rao bound for a network with marks under unknown forces: a limit for any filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from dynamics import MassSpringNetwork, all_positions, motion, unpack
from estimators.arrays import Floats
from estimators.consistency.joseph import joseph_update
from estimators.process.process_model import ForceMode, TissueModel

SHIFT = 1e-6
"""Half-width of central differences [m, m/s]; numerical: rounding errors of the derivatives are 1e-10 of their size."""


def posterior_bound(
    network: MassSpringNetwork,
    states: ArrayLike,
    times_s: ArrayLike,
    marks: Sequence[Mapping[str, Floats]],
    mode: ForceMode,
    start_cov: ArrayLike,
    *,
    poked: Sequence[str] = (),
) -> Floats:
    """Lower bound on the covariance of unbiased state estimates after the marks of each time, (n_times, dim_x, dim_x).

    states: true states, (n_times, n_state); times_s: their times [s], so close that the motion between is nearly linear
    marks: for each time, the covariance of each visible node's mark [m²], (dim, dim); empty if no mark is visible
    mode: densities of the unknown forces, which are white noise on all free nodes and short forces on the nodes `poked`
    start_cov: covariance before the first marks, (dim_x, dim_x)

    For Gaussian noise, the recursion of [tichavsky1998] is the covariance recursion of a Kalman filter with the
    transition matrices of the true states. The result is the bound for one trajectory. The mean of the bounds of
    several trajectories is close to their joint bound.
    """
    x, t = np.asarray(states, dtype=float), np.asarray(times_s, dtype=float)
    model = TissueModel(network, poked)
    n = model.dim_x
    P = np.array(start_cov, dtype=float)
    if x.shape != (len(t), network.n_state) or len(marks) != len(t) or P.shape != (n, n):
        raise ValueError(
            f"expected states ({len(t)}, {network.n_state}), {len(t)} sets of marks and start_cov ({n}, {n}),"
            f" found {x.shape}, {len(marks)} and {P.shape}"
        )
    bounds = np.empty((len(t), n, n))
    nothing = np.zeros(n)
    for k, seen in enumerate(marks):
        if k:
            F, Q = transition(model, x[k - 1], t[k] - t[k - 1], mode)
            P = F @ P @ F.T + Q
        if seen:
            rows = [i for node in seen for i in range(n)[network.coordinates(node)]]
            H = np.eye(n)[rows]
            R = np.zeros((len(rows), len(rows)))
            for j, cov in enumerate(seen.values()):
                own = slice(j * network.dim, (j + 1) * network.dim)
                R[own, own] = cov
            P = joseph_update(nothing, P, np.zeros(len(rows)), H, R)[1]
        bounds[k] = P
    return bounds


def transition(model: TissueModel, state: Floats, dt: float, mode: ForceMode) -> tuple[Floats, Floats]:
    """Transition matrix and noise covariance, (dim_x, dim_x) each, over dt [s] from a state of the network, (n_state,).

    The transition matrix is `exp(A dt)`. A is the matrix of the motion that is linearised at this state. The noise
    covariance is the integral of `exp(A s) D exp(A' s)` over s by Simpson's rule, with D the noise density.
    """
    network = model.network
    shape = all_positions(network, unpack(state, network.dim)[0])
    A, density = model.linearised(shape, mode)
    n = network.n_state
    rate = motion(network)
    for i in range(n):
        step = np.zeros(n)
        step[i] = SHIFT
        A[:n, i] = (rate(state + step, 0.0) - rate(state - step, 0.0)) / (2.0 * SHIFT)
    half = expm(A * (dt / 2.0))
    F = half @ half
    Q = dt / 6.0 * (density + 4.0 * half @ density @ half.T + F @ density @ F.T)
    return F, 0.5 * (Q + Q.T)
