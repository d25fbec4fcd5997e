"""Linearised network about a shape: stiffness and damping matrices, longest stable step."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynamics.arrays import Floats
from dynamics.forces.kernels import (
    SHORTEST,
    node_constants,
    node_resistance,
    spring_constants,
    spring_tension,
    tension_by_length,
    tension_by_rate,
)
from dynamics.network.mass_spring import MassSpringNetwork

RK4_RADIUS = 2.6
"""Classical Runge-Kutta is stable if, for each eigenvalue, its product with the step has at most this modulus and no
positive real part (Hairer and Wanner, IV.2, figure 2.1)."""

STRETCHES = np.linspace(0.5, 1.5, 65)
"""Ratios of length to rest length at which `stable_step` computes the stiffness of a spring."""


def stiffness_matrix(network: MassSpringNetwork, positions: ArrayLike) -> Floats:
    """Second derivative of potential energy with respect to free coordinates [N/m], (n_free dim, n_free dim).

    positions: positions of all nodes [m], (n_nodes, dim)
    A spring of length l and tension T along the unit vector n contributes `dT/dl n n' + T / l (I - n n')`.
    """
    n, lengths = _directions(network, positions)
    c = spring_constants(network)
    along = n[:, :, None] * n[:, None, :]
    across = np.eye(network.dim) - along
    slope = tension_by_length(lengths, 0.0, c)
    blocks = slope[:, None, None] * along + (spring_tension(lengths, 0.0, c) / lengths)[:, None, None] * across
    K = _assembled(network, blocks)
    return K if network.continuum is None else K + network.continuum.stiffness


def damping_matrix(network: MassSpringNetwork, positions: ArrayLike, *, speed_m_s: float = 0.0) -> Floats:
    """Damping matrix of the free coordinates for small motions [N s/m], (n_free dim, n_free dim).

    positions: positions of all nodes [m], (n_nodes, dim)
    speed_m_s: speed at which the resistance of the nodes (force divided by speed) is computed [m/s]
    """
    n, lengths = _directions(network, positions)
    slope = tension_by_rate(lengths, 0.0, spring_constants(network))
    blocks = slope[:, None, None] * n[:, :, None] * n[:, None, :]
    resistance = node_resistance(speed_m_s**2, node_constants(network))
    C = _assembled(network, blocks) + np.diag(np.repeat(resistance[network.free], network.dim))
    return C if network.continuum is None else C + network.continuum.dashpots


def state_matrix(network: MassSpringNetwork, positions: ArrayLike, *, speed_m_s: float = 0.0) -> Floats:
    """Matrix A of the linear motion `d(state)/dt = A (state - rest)` about a rest shape, (n_state, n_state).

    positions: positions of all nodes at rest [m], (n_nodes, dim)
    speed_m_s: speed of the nodes for which their resistance is computed [m/s]
    """
    inverse_mass = 1.0 / np.repeat(network.masses[network.free], network.dim)
    n = len(inverse_mass)
    A = np.zeros((2 * n, 2 * n))
    A[:n, n:] = np.eye(n)
    A[n:, :n] = -inverse_mass[:, None] * stiffness_matrix(network, positions)
    A[n:, n:] = -inverse_mass[:, None] * damping_matrix(network, positions, speed_m_s=speed_m_s)
    return A


def stable_step(network: MassSpringNetwork) -> float:
    """Longest step [s] with which Runge-Kutta is stable, if each spring has 0.5 to 1.5 times its rest length.

    The eigenvalues of the linearised motion have magnitudes of at most `(d + sqrt(d² + 4 w²)) / 2`. Here w² and d are
    the largest eigenvalues of two graph Laplacians divided by the masses. Their weights are
    the largest stiffness and the largest damping of each spring in this range of lengths.
    """
    c = spring_constants(network)
    lengths = STRETCHES[:, None] * c.rest_length
    slopes = np.broadcast_to(tension_by_length(lengths, 0.0, c), lengths.shape)
    stiffness = np.maximum(np.abs(slopes), np.abs(spring_tension(lengths, 0.0, c) / lengths)).max(axis=0)
    damping = np.broadcast_to(tension_by_rate(lengths, 0.0, c), lengths.shape).max(axis=0)
    resistance = node_resistance(0.0, node_constants(network))[network.free]
    scale = 1.0 / np.sqrt(network.masses[network.free])
    w2 = _largest(scale, _laplacian(network, stiffness))
    d = _largest(scale, _laplacian(network, damping) + np.diag(resistance))
    if network.continuum is not None:
        scale = np.repeat(scale, network.dim)
        w2, d = w2 + _largest(scale, network.continuum.stiffness), d + _largest(scale, network.continuum.dashpots)
    return float(RK4_RADIUS / (0.5 * (d + np.sqrt(d * d + 4.0 * w2))))


def _directions(network: MassSpringNetwork, positions: ArrayLike) -> tuple[Floats, Floats]:
    x = np.asarray(positions, dtype=float)
    apart = x[network.springs[:, 1]] - x[network.springs[:, 0]]
    lengths = np.sqrt((apart * apart).sum(axis=1) + SHORTEST**2)
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
    return max(0.0, float(np.linalg.eigvalsh(scale[:, None] * matrix * scale)[-1]))
