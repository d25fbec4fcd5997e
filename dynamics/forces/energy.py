"""Forces and energy of a mass-spring network: the paper's Lagrangian, with its signs corrected.

Source: [paper], equations (3) to (6). The kinetic energy (4) is K = sum m_i v_i.v_i / 2. The potential energy (5) is
k (l - l0)^2 / 2 for each spring, and -m_i g.x_i for the weight of each node. With Rayleigh's dissipation function
P = sum c (dl/dt)^2 / 2 + sum drag_i v_i.v_i / 2, Lagrange's equation (3) gives

    m_i a_i = sum_j (k_ij (l_ij - l0_ij) + c_ij dl_ij/dt) n_ij  -  drag_i v_i  +  m_i g  +  Q_i

with n_ij the unit vector from i to j. This differs from [paper] (6), whose signs let a stretched spring repel its
nodes. The force here is minus the gradient of (5).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dynamics.arrays import Floats
from dynamics.forces.kernels import packed, spring_constants, spring_forces, spring_potential
from dynamics.network.mass_spring import MassSpringNetwork, spring_lengths


def node_forces(network: MassSpringNetwork, positions: ArrayLike, velocities: ArrayLike) -> Floats:
    """Force on each node, including anchors, due to all force laws and gravity [N], (n_nodes, dim).

    positions, velocities: positions [m] and velocities [m/s] of all nodes, (n_nodes, dim) each
    A spring shorter than 1 nm has no direction and exerts no force. Anchors have no weight.
    """
    x = np.array(positions, dtype=float)[..., None]
    v = np.array(velocities, dtype=float)[..., None]
    if x.shape[:-1] != (network.n_nodes, network.dim) or v.shape != x.shape:
        raise ValueError(
            f"expected positions and velocities of shape {(network.n_nodes, network.dim)}, "
            f"found {x.shape[:-1]} and {v.shape[:-1]}"
        )
    force = np.empty_like(x)
    spring_forces(x, v, packed(network), np.empty(1), np.empty(1), force)
    if network.continuum is not None:
        shift = (x - network.positions[..., None])[network.free].reshape(-1)
        pull = network.continuum.stiffness @ shift + network.continuum.dashpots @ v[network.free].reshape(-1)
        force[network.free] -= pull.reshape(-1, network.dim, 1)
    return force[..., 0]


def potential_energy(network: MassSpringNetwork, positions: ArrayLike) -> float:
    """Energy of springs and gravity [J], as in [paper] (5); positions: positions of all nodes [m], (n_nodes, dim)."""
    x = np.asarray(positions, dtype=float)
    lengths = spring_lengths(x, network.springs)
    springs = spring_potential(lengths, spring_constants(network)).sum()
    height = network.masses[network.free] @ (x[network.free] @ network.gravity)
    if network.continuum is None:
        return float(springs - height)
    shift = (x - network.positions)[network.free].ravel()
    return float(springs - height + 0.5 * shift @ network.continuum.stiffness @ shift)


def kinetic_energy(network: MassSpringNetwork, velocities: ArrayLike) -> float:
    """Kinetic energy [J], [paper] (4); velocities: all nodes' velocities [m/s], (n_nodes, dim)."""
    v = np.asarray(velocities, dtype=float)[network.free]
    return float(0.5 * network.masses[network.free] @ (v * v).sum(axis=1))
