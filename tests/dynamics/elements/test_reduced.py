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
