"""The shape in which the tissue rests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from dynamics.forces import node_forces, potential_energy
from dynamics.network import Floats, MassSpringNetwork, NetworkError, all_positions
from dynamics.tangent import stiffness_matrix

RESIDUAL = 1e-9
"""Largest force left on a node at rest, relative to weights and spring tensions."""


def rest_shape(network: MassSpringNetwork, force: ArrayLike = 0.0) -> Floats:
    """Positions of all nodes at the equilibrium nearest downhill from where they are drawn [m], (n_nodes, dim).

    force: held on the free nodes meanwhile [N], (n_free, dim), default none
    A mass-spring network has several rest shapes; the drawn one says which is meant. Raises NetworkError where
    the energy has no stable minimum to be found there.
    """
    shape = (len(network.free), network.dim)
    held = np.broadcast_to(np.asarray(force, dtype=float), shape).ravel()

    def everywhere(q: Floats) -> Floats:
        return all_positions(network, q.reshape(shape))

    def gradient(q: Floats) -> Floats:
        x = everywhere(q)
        return -node_forces(network, x, np.zeros_like(x))[network.free].ravel() - held

    found = minimize(
        lambda q: potential_energy(network, everywhere(q)) - held @ q,
        network.positions[network.free].ravel(),
        jac=gradient,
        hess=lambda q: stiffness_matrix(network, everywhere(q)),
        method="trust-exact",
        options={"gtol": 1e-12, "maxiter": 500, "initial_trust_radius": 0.01, "max_trust_radius": 0.1},
    )
    q = np.asarray(found.x)
    for _ in range(3):  # Newton's last digits, which a trust region on the energy cannot see
        K = stiffness_matrix(network, everywhere(q))
        if np.linalg.eigvalsh(K)[0] <= 0:
            raise NetworkError("rest shape: expected a stable equilibrium near the drawn shape, found none")
        q = q - np.linalg.solve(K, gradient(q))
    scale = np.abs(network.stiffness * network.rest_lengths).max()
    left = np.abs(gradient(q)).max()
    if not left <= RESIDUAL * scale:
        raise NetworkError(f"rest shape: expected forces to balance, found {left:.3g} N left over")
    return everywhere(q)


def shape_held(network: MassSpringNetwork, held: Mapping[str, ArrayLike]) -> Floats:
    """Positions of all nodes where these free nodes are held and the others rest [m], (n_nodes, dim).

    held: position of each held node [m], (dim,). Raises NetworkError as `rest_shape` does.
    """
    positions, fixed = network.positions.copy(), network.fixed.copy()
    for node, position in held.items():
        positions[network.index(node)] = position
        fixed[network.index(node)] = True
    if fixed.all():
        return positions
    return rest_shape(replace(network, positions=positions, fixed=fixed))
