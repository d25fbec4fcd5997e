"""The compiled loops against plain NumPy versions of the same equations."""

import numpy as np
import pytest

from dynamics import all_positions, derivative, pack, plain_derivative, plain_step, unpack
from dynamics.forces.kernels import packed, runge_kutta
from tests.dynamics.conftest import textbook_force


def random_states(network, n_points, seed=5):
    """States away from the drawn shape [m, m/s], (n_points, n_state)."""
    rng = np.random.default_rng(seed)
    shape = (n_points, len(network.free), network.dim)
    x = network.positions[network.free] + 0.05 * rng.normal(size=shape)
    return pack(x, 0.5 * rng.normal(size=shape))


def run(network, states, outside, dt, n_steps):
    inverse_mass = np.zeros(network.n_nodes)
    inverse_mass[network.free] = 1.0 / network.masses[network.free]
    return runge_kutta(states, outside, dt, n_steps, network.positions, network.free, inverse_mass, packed(network))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("n_steps", [1, 3])
def test_runge_kutta_is_the_classical_tableau(tangled, dim, n_steps):
    """Butcher's tableau 1/2, 1/2, 1; 1/6, 1/3, 1/3, 1/6 over `textbook_force` and held outside forces. Rounding."""
    network, h = tangled(dim), 0.01
    states = random_states(network, 4)
    outside = np.random.default_rng(6).normal(size=(4, network.n_state // 2))

    def slope_of(state, force):
        free_x, free_v = unpack(state, dim)
        x = all_positions(network, free_x)
        v = np.zeros_like(x)
        v[network.free] = free_v
        total = textbook_force(network, x, v)[network.free] + force.reshape(-1, dim)
        return pack(free_v, total / network.masses[network.free, None])

    nodes, weights = [0.0, 0.5, 0.5, 1.0], [1 / 6, 1 / 3, 1 / 3, 1 / 6]
    found = run(network, states, outside, h, n_steps)
    for state, force, end in zip(states, outside, found, strict=True):
        expected = state
        for _ in range(n_steps):
            slopes = [np.zeros_like(state)]
            for c in nodes:
                slopes.append(slope_of(expected + c * h * slopes[-1], force))
            expected = expected + h * np.array(weights) @ np.array(slopes[1:])
        np.testing.assert_allclose(end, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_plain_version_is_the_same_equation(tangled, dim):
    """`plain_derivative` and `plain_step` against the compiled ones: accelerations of some 100 m/s², rounding."""
    network = tangled(dim)
    states = random_states(network, 3)
    ends = run(network, states, np.zeros((3, network.n_state // 2)), 0.005, 4)
    for state, end in zip(states, ends, strict=True):
        np.testing.assert_allclose(plain_derivative(network, state), derivative(network, state), rtol=0, atol=1e-11)
        np.testing.assert_allclose(plain_step(network, state, 0.02, 4), end, rtol=0, atol=1e-13)
