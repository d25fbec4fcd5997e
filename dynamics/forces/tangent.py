"""The network linearised about a shape: stiffness and damping matrices, and the step that stays stable."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynamics.arrays import Floats
from dynamics.forces.kernels import SLIP_VELOCITY
from dynamics.network.mass_spring import MassSpringNetwork

RK4_RADIUS = 2.6
"""Classical Runge-Kutta is stable in the left half of the disc of this radius (Hairer and Wanner, IV.2, figure 2.1)."""


def stiffness_matrix(network: MassSpringNetwork, positions: ArrayLike) -> Floats:
    """Second derivative of the potential energy by the free coordinates [N/m], (n_free dim, n_free dim).

    positions of all nodes [m], (n_nodes, dim). Each spring gives k n n' + k (1 - l0 / l) (I - n n').
    """
    n, lengths = _directions(network, positions)
    along = n[:, :, None] * n[:, None, :]
    across = np.eye(network.dim) - along
    slack = 1.0 - network.rest_lengths / lengths
    blocks = network.stiffness[:, None, None] * (along + slack[:, None, None] * across)
    return _assembled(network, blocks)


def damping_matrix(network: MassSpringNetwork, positions: ArrayLike) -> Floats:
    """Derivative of the resisting force by the free velocities, at rest [N s/m], (n_free dim, n_free dim)."""
    n, _ = _directions(network, positions)
    blocks = network.damping[:, None, None] * n[:, :, None] * n[:, None, :]
    resist = network.drag + network.friction / SLIP_VELOCITY
    return _assembled(network, blocks) + np.diag(np.repeat(resist[network.free], network.dim))


def state_matrix(network: MassSpringNetwork, positions: ArrayLike) -> Floats:
    """Matrix A of d(state)/dt = A (state - rest) about a rest shape, (n_state, n_state)."""
    inverse_mass = 1.0 / np.repeat(network.masses[network.free], network.dim)
    n = len(inverse_mass)
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:, :n] = -inverse_mass[:, None] * stiffness_matrix(network, positions)
    A[n:, n:] = -inverse_mass[:, None] * damping_matrix(network, positions)
    return A


def stable_step(network: MassSpringNetwork) -> float:
    """Longest step for which Runge-Kutta stays stable while no spring is shorter than half its rest length [s].

    Until then a spring's tangent stiffness is at most k in size in every direction, so the weighted graph Laplacian
    bounds the stiffness of all such shapes, and the same with dashpots. With w² and d their largest eigenvalues by
    mass, every eigenvalue of the linearised motion is at most (d + sqrt(d² + 4 w²)) / 2.
    """
    scale = 1.0 / np.sqrt(network.masses[network.free])
    resist = (network.drag + network.friction / SLIP_VELOCITY)[network.free]
    w2 = _largest(scale, _laplacian(network, network.stiffness))
    d = _largest(scale, _laplacian(network, network.damping) + np.diag(resist))
    return float(RK4_RADIUS / (0.5 * (d + np.sqrt(d * d + 4.0 * w2))))


def _directions(network: MassSpringNetwork, positions: ArrayLike) -> tuple[Floats, Floats]:
    x = np.asarray(positions, dtype=float)
    apart = x[network.springs[:, 1]] - x[network.springs[:, 0]]
    lengths = np.linalg.norm(apart, axis=1)
    return apart / lengths[:, None], lengths


def _assembled(network: MassSpringNetwork, blocks: Floats) -> Floats:
    full = np.zeros((network.n_nodes, network.dim, network.n_nodes, network.dim))
    for (i, j), block in zip(network.springs, blocks, strict=True):
        full[i, :, i] += block
        full[j, :, j] += block
        full[i, :, j] -= block
        full[j, :, i] -= block
    n = len(network.free) * network.dim
    return full[network.free][:, :, network.free].reshape(n, n)


def _laplacian(network: MassSpringNetwork, weights: Floats) -> Floats:
    full = np.zeros((network.n_nodes, network.n_nodes))
    for (i, j), weight in zip(network.springs, weights, strict=True):
        full[i, i] += weight
        full[j, j] += weight
        full[i, j] -= weight
        full[j, i] -= weight
    return full[np.ix_(network.free, network.free)]


def _largest(scale: Floats, matrix: Floats) -> float:
    return float(np.linalg.eigvalsh(scale[:, None] * matrix * scale)[-1])
