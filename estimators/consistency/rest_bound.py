"""Steady-state posterior Cramér-Rao bound for a body at rest: a limit for any filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import expm

from dynamics import SLIP_VELOCITY, MassSpringNetwork, rest_shape, supported
from estimators.arrays import Floats
from estimators.process.process_model import ForceMode, TissueModel, accumulated_noise

LONG_RUN_S = 3600.0
"""Time [s] after which the bound is evaluated, even if it is not steady then. It never becomes steady if, for example,
the marks do not determine the position of a part of the body."""

SETTLED = 1e-6
"""The bound is steady if doubling the number of frames changes it by at most this share; numerical."""

STATIONARY_S = 60.0
"""Time after which the motion of a body with friction is assumed to be stationary [s]; numerical."""

PASSES = 20
"""Number of fixed-point iterations; numerical: each changes the drag by at most a third of the previous change."""


def resting_bound(
    network: MassSpringNetwork,
    marks: Mapping[str, Floats],
    interval_s: float,
    mode: ForceMode,
    *,
    poked: Sequence[str] = (),
) -> Floats:
    """Lower bound on the covariance of any unbiased estimate of a body near rest after many frames, (dim_x, dim_x).

    marks: covariance of each mark [m²], (dim, dim), by node; these marks are visible in every frame
    interval_s: time between frames [s]
    mode: densities of the unknown forces, which are white noise on all free nodes and short forces on the nodes `poked`

    The bound is the limit of the recursion in `posterior_bound`. A doubling algorithm computes this limit: k steps give
    the bound after 2^k frames [anderson1978]. Constants are assumed to be exact. `friction_as_drag` replaces friction.
    Raises NetworkError if there is no rest shape.
    """
    body, rest = supported(network), rest_shape(network)
    model = TissueModel(friction_as_drag(body, rest, mode, poked), poked)
    A, density = model.linearised(rest, mode)
    F, P = expm(A * interval_s), accumulated_noise(A, density, interval_s)
    G = np.zeros_like(P)  # information of a frame, H' R^-1 H
    for node, cov in marks.items():
        own = body.coordinates(node)
        G[own, own] = np.linalg.inv(cov)
    # P: covariance before the marks of a frame, 2^k frames after an exact start
    identity, moved, information = np.eye(len(P)), F.T, G
    for _ in range(int(np.ceil(np.log2(LONG_RUN_S / interval_s)))):
        W = np.linalg.inv(identity + information @ P)
        added = moved.T @ P @ W @ moved
        information = information + moved @ W @ information @ moved.T
        moved = moved @ W @ moved
        P = P + 0.5 * (added + added.T)
        if np.abs(added).max() <= SETTLED * np.abs(P).max():
            break
    return np.asarray(np.linalg.solve(identity + P @ G, P), dtype=float)


def friction_as_drag(
    network: MassSpringNetwork, rest: Floats, mode: ForceMode, poked: Sequence[str]
) -> MassSpringNetwork:
    """The network with viscous drag in place of dry friction, by statistical linearisation [gelb1974].

    rest: rest shape [m], (n_nodes, dim); poked: nodes on which short forces act
    The drag added to a node is its friction divided by the root mean square speed that forces of `mode` cause.
    """
    smooth = replace(network, friction=np.zeros(network.n_nodes))
    if not network.friction[network.free].any():
        return smooth
    half, dim = network.n_state // 2, network.dim
    for _ in range(PASSES):
        model = TissueModel(smooth, poked)
        spread = np.diag(accumulated_noise(*model.linearised(rest, mode), STATIONARY_S))[half : 2 * half]
        drag = network.drag.copy()
        square = spread.reshape(-1, dim).sum(axis=1)
        drag[network.free] += network.friction[network.free] / np.sqrt(square + SLIP_VELOCITY**2)
        smooth = replace(smooth, drag=drag)
    return smooth
