"""Networks that the tests of the tissue share, and the textbook's equation of motion as their oracle."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # at twenty states more threads only wait for each other

import numpy as np
import pytest

from dynamics import MassSpringNetwork, four_mass_phantom
from tests.networks import build_network

SLIP = 5e-3
"""Speed over which Coulomb friction builds up [m/s]; written out so that a change of the constant is seen."""


def random_network(dim: int, **changes) -> MassSpringNetwork:
    """Five nodes a few decimetres apart, two of them anchors, all joined, every constant different."""
    rng = np.random.default_rng(11 + dim)
    corners = np.array([[0.0, 0, 0], [0.3, 0, 0.1], [0.3, 0.3, -0.1], [0, 0.3, 0.2], [0.15, 0.5, 0.15]])[:, :dim]
    springs = [(i, j) for i in range(5) for j in range(i + 1, 5) if (i, j) != (0, 2)]
    n = len(springs)
    fields = {
        "masses": rng.uniform(0.1, 0.4, 5),
        "drag": rng.uniform(0.1, 0.4, 5),
        "friction": rng.uniform(0.01, 0.03, 5),
        "stiffness": rng.uniform(50.0, 150.0, n),
        "rest_lengths": rng.uniform(0.2, 0.5, n),
        "damping": rng.uniform(0.1, 0.6, n),
        "gravity": np.array([0.7, -9.81, -0.4])[:dim],
    }
    return build_network(corners, springs, (0, 3), **(fields | changes))


def moved(network, seed=3):
    """Positions away from the drawn ones [m] and velocities [m/s] of all nodes; anchors neither moved nor moving."""
    rng = np.random.default_rng(seed)
    x, v = network.positions.copy(), np.zeros_like(network.positions)
    x[network.free] += 0.05 * rng.normal(size=x[network.free].shape)
    v[network.free] = 0.3 * rng.normal(size=x[network.free].shape)
    return x, v


def textbook_force(network, x, v):
    """Sum of (k (l - l0) + c dl/dt) n  -  drag v  -  friction v / sqrt(v² + slip²)  +  m g, node by node [N]."""
    force = np.zeros_like(x)
    for i in range(network.n_nodes):
        weight = np.zeros(network.dim) if network.fixed[i] else network.masses[i] * network.gravity
        slide = v[i] / np.sqrt(v[i] @ v[i] + SLIP**2)
        force[i] = weight - network.drag[i] * v[i] - network.friction[i] * slide
    for s, (i, j) in enumerate(network.springs):
        apart = x[j] - x[i]
        length = np.sqrt(apart @ apart)
        n = apart / length
        stretching = (v[j] - v[i]) @ n
        tension = network.stiffness[s] * (length - network.rest_lengths[s]) + network.damping[s] * stretching
        force[i] += tension * n
        force[j] -= tension * n
    return force


def slope(function, at, h):
    """Derivative of an array-valued function by each entry of `at`, last axis; five-point rule, error h⁴ f⁽⁵⁾ / 30."""
    columns = []
    for k in range(at.size):
        e = np.zeros(at.size)
        e[k] = h
        e = e.reshape(at.shape)
        f = [np.asarray(function(at + a * e)) for a in (-2, -1, 1, 2)]
        columns.append((f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h))
    return np.stack(columns, axis=-1)


@pytest.fixture(name="build")
def _build():
    return build_network


@pytest.fixture(name="tangled")
def _tangled():
    return random_network


@pytest.fixture(scope="session")
def phantom() -> MassSpringNetwork:
    return four_mass_phantom()
