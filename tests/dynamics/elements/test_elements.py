"""Each kind of element has the slopes of its force; assembled, all are the network, whose laws `test_laws.py` tests."""

import numpy as np
import pytest

from dynamics import damping_matrix, node_forces, potential_energy, stiffness_matrix
from dynamics.elements import Assembly, Resistance, Springs, Weight
from dynamics.forces.kernels import NodeConstants, SpringConstants
from tests.dynamics.conftest import moved, slope

N = 4
"""Elements of a kind."""


def springs(dim, constants=None):
    rng = np.random.default_rng(dim)
    own = SpringConstants(rng.uniform(50, 150, N), rng.uniform(0.2, 0.5, N), rng.uniform(0.1, 0.6, N))
    return Springs(np.arange(2 * N).reshape(N, 2), constants or own)


def weight(dim, constants=None):
    return Weight(np.arange(N)[:, None], np.random.default_rng(dim).normal(size=(N, dim)))


def resistance(dim, constants=None):
    rng = np.random.default_rng(dim)
    own = NodeConstants(rng.uniform(0.1, 0.4, N), rng.uniform(0.01, 0.03, N))
    return Resistance(np.arange(N)[:, None], constants or own)


KINDS_OF_ELEMENT = {
    "springs": (springs, {"stiffness", "rest_length", "damping"}),
    "weight": (weight, set()),
    "resistance": (resistance, {"drag", "friction"}),
}

every_kind = pytest.mark.parametrize("kind", KINDS_OF_ELEMENT)
each_dim = pytest.mark.parametrize("dim", [2, 3])


def corners(element, dim):
    """Positions some decimetres apart and velocities of some cm/s."""
    rng = np.random.default_rng(5)
    shape = (*element.nodes.shape, dim)
    return rng.uniform(-0.3, 0.3, shape), 0.03 * rng.normal(size=shape)


def by_element(slopes, shape):
    """Slopes (n, c, dim, n c dim) by all corners as (n, c, dim, c, dim) by an element's own; the others are zero."""
    full = slopes.reshape(*shape, *shape)
    own = np.einsum("ncdnef->ncdef", full).copy()
    for k in range(len(full)):
        full[k, :, :, k] = 0.0
    np.testing.assert_allclose(full, 0.0, atol=1e-8)
    return own


@each_dim
@every_kind
def test_tangents_are_minus_the_slopes_of_the_force(kind, dim):
    """In motion; friction bends over 5 mm/s: five-point error (h / 5e-3)⁴ 4 N s/m = 6e-11 at 1e-5 m/s."""
    element = KINDS_OF_ELEMENT[kind][0](dim)
    x, v = corners(element, dim)
    stiffness, _ = element.tangents(x, v)
    expected = -by_element(slope(lambda at: element.force(at, v), x, 2e-4), x.shape)
    np.testing.assert_allclose(stiffness, expected, rtol=0, atol=1e-6)
    for speed in (v, np.zeros_like(v)):
        _, damping = element.tangents(x, speed)
        expected = -by_element(slope(lambda at: element.force(x, at), speed, 1e-5), x.shape)
        np.testing.assert_allclose(damping, expected, rtol=0, atol=1e-7)


@each_dim
@every_kind
def test_derivatives_by_constants_are_slopes_of_the_force(kind, dim):
    make, constants = KINDS_OF_ELEMENT[kind]
    element = make(dim)
    x, v = corners(element, dim)
    found = element.by_log_constants(x, v)
    assert set(found) == constants
    for name, derivative in found.items():

        def force(log, name=name):
            grown = getattr(element.constants, name) * np.exp(log)
            return make(dim, element.constants._replace(**{name: grown})).force(x, v)

        np.testing.assert_allclose(derivative, slope(force, np.zeros(1), 1e-3)[..., 0], rtol=0, atol=1e-9)


def free_of(network, field):
    return field[network.free].ravel()


@pytest.mark.parametrize("order", [1, -1])
@each_dim
def test_assembled_elements_are_the_compiled_network(tangled, dim, order):
    """Force in motion, energy, and tangents at rest; anchors have no coordinates, free nodes the order given."""
    network = tangled(dim)
    x, v = moved(network)
    free = network.free[::order]
    assembly, q = Assembly(network.positions, free, Assembly.of_network(network).elements), x[free].ravel()
    force = node_forces(network, x, v)[free].ravel()
    np.testing.assert_allclose(assembly.force(q, v[free].ravel()), force, rtol=0, atol=1e-12)
    np.testing.assert_allclose(assembly.energy(q), potential_energy(network, x), rtol=0, atol=1e-12)
    rows = np.arange(len(q)).reshape(-1, dim)[::order].ravel()
    for found, of in zip(assembly.tangents(q, np.zeros_like(q)), (stiffness_matrix, damping_matrix), strict=True):
        np.testing.assert_allclose(found.toarray(), of(network, x)[np.ix_(rows, rows)], rtol=0, atol=1e-10)


class Hidden:
    """An element whose kind no assembly knows."""

    def __init__(self, element):
        self.nodes, self.energy, self.force = element.nodes, element.energy, element.force
        self.tangents, self.by_log_constants = element.tangents, element.by_log_constants


@pytest.mark.parametrize("hidden", [(), (0,), (0, 1, 2)])
@each_dim
def test_compiled_and_other_elements_add_up(tangled, dim, hidden):
    """The kernel of the kinds of a network, twice over, against the methods of each element."""
    network = tangled(dim)
    x, v = moved(network)
    q, u = free_of(network, x), free_of(network, v)
    elements = 2 * Assembly.of_network(network).elements
    at = network.positions, network.free
    plain = Assembly(*at, [Hidden(element) for element in elements])
    mixed = Assembly(*at, [Hidden(one) if k in hidden else one for k, one in enumerate(elements)])
    force, K, C = mixed.linearised(q, u)
    np.testing.assert_allclose(force, plain.force(q, u), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(force, mixed.force(q, u))
    for found, expected in zip((K, C), plain.tangents(q, u), strict=True):
        np.testing.assert_allclose(found, expected.toarray(), rtol=0, atol=1e-11 * np.abs(expected).max())
