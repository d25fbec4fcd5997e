"""Equations of motion in plain NumPy, with which the compiled kernels are compared in speed and results.

`softaim bench` measures the time of filterpy's filter with this process model. Tests compare the kernels with this
module. Both use the force laws of `dynamics.forces.kernels`. The tests contain an independent version of these laws.
"""

from __future__ import annotations

import numpy as np

from dynamics.arrays import Floats
from dynamics.forces.kernels import node_constants, node_resistance, spring_constants, spring_tension
from dynamics.network.mass_spring import MassSpringNetwork, all_positions, pack, unpack


def plain_derivative(network: MassSpringNetwork, state: Floats) -> Floats:
    """Time derivative of a state [m, m/s], (n_state,), without outside forces; see `dynamics.forces.energy`."""
    free_x, free_v = unpack(state, network.dim)
    x = all_positions(network, free_x)
    v = np.zeros_like(x)
    v[network.free] = free_v
    i, j = network.springs.T
    apart = x[j] - x[i]
    lengths = np.linalg.norm(apart, axis=1)
    n = apart / lengths[:, None]
    stretching = ((v[j] - v[i]) * n).sum(axis=1)
    tension = spring_tension(lengths, stretching, spring_constants(network))
    resistance = node_resistance((v * v).sum(axis=1), node_constants(network))
    force = network.masses[:, None] * network.gravity - resistance[:, None] * v
    np.add.at(force, i, tension[:, None] * n)
    np.add.at(force, j, -tension[:, None] * n)
    return pack(free_v, force[network.free] / network.masses[network.free, None])


def plain_step(network: MassSpringNetwork, state: Floats, dt: float, n_steps: int) -> Floats:
    """State after n_steps classical Runge-Kutta steps over a total time dt [s], (n_state,)."""
    h = dt / n_steps
    for _ in range(n_steps):
        k1 = plain_derivative(network, state)
        k2 = plain_derivative(network, state + h / 2 * k1)
        k3 = plain_derivative(network, state + h / 2 * k2)
        k4 = plain_derivative(network, state + h * k3)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state
