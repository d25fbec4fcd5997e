"""Bodies that move in few shapes, against the equations of motion of all nodes."""

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import MassSpringNetwork
from dynamics.elements import Assembly, ReducedAssembly, Span, smooth_shapes
from tests.networks import slab


@pytest.fixture(scope="module", name="slab")
def made_slab() -> MassSpringNetwork:
    return slab()


def pushes(network: MassSpringNetwork) -> np.ndarray:
    """Forces on the end of the slab, along each axis [N], (n_free dim, 3)."""
    end = network.positions[network.free][:, 0] > 0.11
    return np.kron(0.05 * end[:, None], np.eye(3))


def reduced(network: MassSpringNetwork, least_m: float) -> tuple[Assembly, Span, ReducedAssembly]:
    assembly, masses = Assembly.of_network(network), network.masses[network.free]
    places = network.positions[network.free]
    shapes = smooth_shapes(assembly, places, masses, pushes(network), (0.5, 5.0, 30.0), least_m)
    span = Span.of_shapes(shapes, masses, network.dim)
    return assembly, span, ReducedAssembly(assembly, span)


def test_coordinates_are_projected_in_the_norm_of_the_masses(slab: MassSpringNetwork) -> None:
    """The left inverse leaves what no shape has orthogonal to all of them, by mass; unit coordinates move by 1 m."""
    _, span, _ = reduced(slab, 1e-4)
    M = np.repeat(slab.masses[slab.free], 3)
    n, rng = span.matrix.shape[1], np.random.default_rng(2)
    np.testing.assert_allclose(span.onto @ span.matrix, np.eye(n), atol=1e-10)
    q = rng.normal(size=len(M))
    np.testing.assert_allclose(span.matrix.T @ (M * (q - span.matrix @ (span.onto @ q))), 0.0, atol=1e-12)
    np.testing.assert_allclose(span.matrix.T @ (M[:, None] * span.matrix), np.diag(span.masses), atol=1e-10)
    moved = np.linalg.norm(span.matrix.reshape(-1, 3, n), axis=1)
    np.testing.assert_allclose((slab.masses[slab.free] @ moved**2) / slab.masses[slab.free].sum(), 1.0, rtol=1e-9)


def test_white_accelerations_of_the_nodes_are_white_in_the_coordinates(slab: MassSpringNetwork) -> None:
    """Independent of each other, with the variances stated."""
    _, span, _ = reduced(slab, 1e-4)
    np.testing.assert_allclose(span.onto @ span.onto.T, np.diag(span.white**2), atol=1e-12)


def test_affine_motions_are_exact(slab: MassSpringNetwork) -> None:
    """A body that is turned, stretched and moved is held by its coordinates, with its forces."""
    assembly, span, few = reduced(slab, 1e-4)
    assert span.matrix.shape[1] < 0.7 * assembly.n
    turn = expm(np.array([[0.0, -0.4, 0.1], [0.4, 0.0, -0.2], [-0.1, 0.2, 0.0]])) @ np.diag([1.1, 0.95, 1.0])
    q = (slab.positions[slab.free] @ turn.T + [0.01, 0.0, -0.02]).ravel()
    z, v = span.onto @ q, np.zeros_like(q)
    np.testing.assert_allclose(span.matrix @ z, q, atol=1e-12)
    np.testing.assert_allclose(few.force(z, span.onto @ v), span.matrix.T @ assembly.force(q, v), atol=1e-10)


def test_tangents_are_minus_the_slopes_of_the_force(slab: MassSpringNetwork) -> None:
    """By central differences in every coordinate and speed."""
    _, span, few = reduced(slab, 3e-4)
    rng, n = np.random.default_rng(1), span.matrix.shape[1]
    z = span.onto @ slab.positions[slab.free].ravel() + 2e-3 * rng.normal(size=n)
    w = 0.05 * rng.normal(size=n)
    force, K, C = few.linearised(z, w)
    np.testing.assert_allclose(force, few.force(z, w), rtol=1e-12)
    steps = 1e-6 * np.eye(n)
    by_z = np.array([(few.force(z + step, w) - few.force(z - step, w)) / 2e-6 for step in steps]).T
    by_w = np.array([(few.force(z, w + step) - few.force(z, w - step)) / 2e-6 for step in steps]).T
    np.testing.assert_allclose(C, -by_w, atol=1e-6 * np.abs(C).max())
    np.testing.assert_allclose(K, -by_z, atol=0.03 * np.abs(K).max())  # the turn of dashpots is left out


@pytest.mark.parametrize(("least_m", "error"), [(1e-3, 0.05), (1e-4, 0.01), (1e-5, 1e-3)])
def test_a_body_follows_its_forces_in_few_shapes(slab: MassSpringNetwork, least_m: float, error: float) -> None:
    """The answer to a force that grows at a rate in between, against all nodes: the better, the more shapes."""
    assembly, span, few = reduced(slab, least_m)
    q = slab.positions[slab.free].ravel()
    force, M = pushes(slab)[:, 1] + 0.3 * pushes(slab)[:, 2], np.repeat(slab.masses[slab.free], 3)
    K, C = (matrix.toarray() for matrix in assembly.tangents(q, np.zeros_like(q)))
    exact = np.linalg.solve(K + 10.0 * C + 100.0 * np.diag(M), force)
    _, k, c = few.linearised(span.onto @ q, np.zeros(few.n))
    found = span.matrix @ np.linalg.solve(k + 10.0 * c + 100.0 * np.diag(span.masses), force @ span.matrix)
    assert np.linalg.norm(found - exact) < error * np.linalg.norm(exact)
    assert few.n < assembly.n
