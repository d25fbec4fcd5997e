"""Factors of a mesh against NumPy's dense solution."""

import numpy as np
import pytest
from scipy.sparse import csc_array, csr_array

from dynamics.mesh import MeshCholesky, cholesky, patches, rest_stiffness
from tests.dynamics.blocks import block


def _cells(mesh, patch):
    return csr_array((np.ones(mesh.elements.size), (np.repeat(patch, 4), mesh.elements.ravel())))


@pytest.mark.parametrize("leaf", [1, 100, 10**6])
@pytest.mark.parametrize("patched", [False, True])
def test_solutions_are_those_of_the_dense_matrix(monkeypatch, leaf, patched):
    """From parts of one cell to one part; patches couple nodes of several elements. Tolerance: rounding."""
    monkeypatch.setattr(cholesky, "LEAF", leaf)
    mesh = block((3, 4, 5), (0.04, 0.05, 0.06), regions=np.arange(360) % 2)
    patch = patches(mesh) if patched else np.arange(len(mesh.elements))
    free = np.flatnonzero(mesh.nodes[:, 0] > 0.0)[::-1]
    K = rest_stiffness(mesh, 3e3, 0.45, free, patch)
    forces = np.random.default_rng(0).normal(size=(K.shape[0], 4))
    found = MeshCholesky(K, mesh.nodes[free], _cells(mesh, patch)[:, free]).solve(forces)
    expected = np.linalg.solve(K.toarray(), forces)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_a_matrix_of_one_row_a_node_is_factored():
    K = csc_array(np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]]))
    factor = MeshCholesky(K, np.eye(3), csr_array(np.array([[1, 1, 0], [0, 1, 1]])))
    np.testing.assert_allclose(factor.solve(np.array([[0.0], [0.0], [4.0]])), [[1.0], [2.0], [3.0]], rtol=1e-14)


def test_a_matrix_that_is_not_positive_definite_is_refused():
    mesh = block((1, 1, 1), (0.04, 0.05, 0.06))
    K = rest_stiffness(mesh, 3e3, 0.3)
    with pytest.raises(np.linalg.LinAlgError):
        MeshCholesky(csc_array(-K), mesh.nodes, _cells(mesh, np.arange(6)))
