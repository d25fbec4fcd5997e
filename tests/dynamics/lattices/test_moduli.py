"""Virtual tests against bodies whose moduli are known in closed form."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy.sparse import csc_array

from dynamics import NetworkError
from dynamics.lattices import (
    DIRECTIONS,
    effective_moduli,
    effective_stiffness,
    free_sided_young,
    lattice_of,
    orthotropic_moduli,
    sheet,
    spring_stiffness,
    young_along,
)
from dynamics.mesh import lame, rest_stiffness
from dynamics.mesh.tissues import TISSUES
from tests.dynamics.blocks import block
from tests.networks import build_network


def isotropic(young, poisson):
    """Hooke's law by Voigt's order."""
    lam, mu = lame(young, poisson)
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    return C


def cubic(k_edge, k_diagonal, a=0.01, n=3):
    """Edges and face diagonals of n³ cubes; a spring that cubes share has a share from each."""
    nodes = a * np.array(list(product(range(n + 1), repeat=3)), dtype=float)
    stiffness = {}
    for cell in product(range(n), repeat=3):
        corners = [np.add(cell, step) for step in product((0, 1), repeat=3)]
        for one, other in combinations(corners, 2):
            apart = np.abs(one - other).sum()
            if apart < 3:
                pair = tuple(int(np.ravel_multi_index(tuple(c), (n + 1,) * 3)) for c in (one, other))
                stiffness[pair] = stiffness.get(pair, 0.0) + (k_edge / 4 if apart == 1 else k_diagonal / 2)
    return build_network(nodes, list(stiffness), stiffness=np.array(list(stiffness.values())))


def test_a_cubic_lattice_has_its_moduli_in_closed_form():
    """C11 = (k1 + 2 k2) / a, C12 = C44 = k2 / a [kot2015]: springs of edges k1 and of face diagonals k2."""
    a, k1, k2 = 0.01, 30.0, 20.0
    moduli = effective_moduli(cubic(k1, k2, a))
    expected = np.diag([(k1 + 2 * k2) / a] * 3 + [k2 / a] * 3)
    expected[:3, :3] += k2 / a * (1 - np.eye(3))
    np.testing.assert_allclose(moduli.stiffness, expected, rtol=1e-9, atol=1e-6)
    c11, c12 = (k1 + 2 * k2) / a, k2 / a
    np.testing.assert_allclose(moduli.young, (c11 - c12) * (c11 + 2 * c12) / (c11 + c12), rtol=1e-9)
    np.testing.assert_allclose(moduli.poisson, c12 / (c11 + c12), rtol=1e-9)
    assert moduli.bulk == pytest.approx((c11 + 2 * c12) / 3, rel=1e-9)


def test_equal_springs_make_it_isotropic_with_poissons_ratio_a_quarter():
    """Both springs have k = 0.4 E a [kot2015]."""
    moduli = effective_moduli(cubic(0.4 * 5e3 * 0.01, 0.4 * 5e3 * 0.01))
    np.testing.assert_allclose(moduli.stiffness, isotropic(5e3, 0.25), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(moduli.poisson, 0.25, rtol=1e-9)
    assert moduli.anisotropy == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.45])
def test_elements_of_one_tissue_have_its_moduli(poisson):
    mesh = block((3, 2, 4), (0.03, 0.04, 0.05))
    K = rest_stiffness(mesh, 4e3, poisson)
    np.testing.assert_allclose(effective_stiffness(K, mesh.nodes), isotropic(4e3, poisson), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(free_sided_young(K, mesh.nodes), 4e3, rtol=1e-9)
    np.testing.assert_allclose(young_along(isotropic(4e3, poisson), DIRECTIONS), 4e3, rtol=1e-12)


def test_elements_in_layers_have_the_moduli_of_a_laminate():
    """Backus' averages of layers across z [backus1962]: strain in the plane is alike in all, stress across it too."""
    mesh = block((2, 2, 4), (0.02, 0.02, 0.02), jitter=0.0)
    stiff = mesh.nodes[mesh.elements].mean(axis=1)[:, 2] < 0.005
    young, poisson = np.where(stiff, 90e3, 3e3), np.where(stiff, 0.3, 0.4)
    found = effective_stiffness(rest_stiffness(mesh, young, poisson), mesh.nodes)
    lam, mu = (np.asarray(c) for c in lame(np.array([90e3, 3e3]), np.array([0.3, 0.4])))
    share, across = np.array([0.25, 0.75]), lam + 2 * mu
    c33 = 1 / (share @ (1 / across))
    c13 = share @ (lam / across) * c33
    c12 = share @ (2 * mu * lam / across) + (share @ (lam / across)) ** 2 * c33
    c66, c44 = share @ mu, 1 / (share @ (1 / mu))
    expected = np.diag([c12 + 2 * c66, c12 + 2 * c66, c33, c44, c44, c66])
    for i, j, value in ((0, 1, c12), (0, 2, c13), (1, 2, c13)):
        expected[i, j] = expected[j, i] = value
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-5)


@pytest.fixture(name="layers", scope="module")
def _layers():
    """Nodes and stiffness of a box of uneven layers."""
    lattice = lattice_of(sheet(np.random.default_rng(2)), 0.02, 5, np.random.default_rng(2))
    return lattice.mesh.nodes, lattice.element_stiffness([TISSUES["fat"], TISSUES["fascia"]])


def test_moduli_lie_below_those_with_all_displacements_given(layers):
    """Fewer displacements are given in mixed tests, and fewer again with free sides, so that less energy is stored."""
    nodes, K = layers
    mixed = effective_stiffness(K, nodes)
    inner = ((nodes > 1e-9) & (nodes < 0.02 - 1e-9)).all(axis=1)
    given = relaxed(K, nodes, np.repeat(~inner, 3).reshape(-1, 3))
    assert np.linalg.eigvalsh(given[:3, :3] - mixed[:3, :3]).min() > 0.0
    assert (np.diag(given) > 1.001 * np.diag(mixed)).all()
    assert (free_sided_young(K, nodes) < 0.9999 * orthotropic_moduli(mixed).young).all()


def test_boundaries_are_those_of_a_symmetric_periodic_body(layers):
    """Given by [pahr2008] in the shear xy: y, z on faces across x; x, z on those across y; z on the others."""
    nodes, K = layers
    mixed = effective_stiffness(K, nodes)
    on_x, on_y, on_z = np.isclose(nodes % 0.02, 0.0, atol=1e-9).T | np.isclose(nodes, 0.02).T
    sheared = relaxed(K, nodes, np.stack([on_y, on_x, on_x | on_y | on_z], axis=1))
    assert mixed[5, 5] == pytest.approx(sheared[5, 5], rel=1e-9)
    normal = relaxed(K, nodes, np.stack([on_x, on_y, on_z], axis=1))
    np.testing.assert_allclose(mixed[:3, :3], normal[:3, :3], rtol=1e-9)
    np.testing.assert_array_equal(mixed[:3, 3:], 0.0)
    np.testing.assert_array_equal(mixed[3:, 3:], np.diag(np.diag(mixed)[3:]))


def relaxed(K, nodes, given):
    """Stiffness by six affine strains with some displacements given, by node and axis, by dense algebra."""
    moved = np.zeros((len(nodes), 3, 6))
    for q, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]):
        moved[:, i, q] += 0.5 * nodes[:, j]
        moved[:, j, q] += 0.5 * nodes[:, i]
    free, u, dense = ~given.ravel(), moved.reshape(-1, 6), csc_array(K).toarray()
    u[free] = np.linalg.solve(dense[np.ix_(free, free)], -dense[np.ix_(free, ~free)] @ u[~free])
    return u.T @ dense @ u / 0.02**3


@pytest.mark.parametrize(
    ("place", "ends"), [((0.015, 0.02, 0.02), (26,)), ((0.013, 0.014, 0.016), (0,)), ((0.013, 0.014, 0.016), (0, 5))]
)
def test_a_loose_node_is_refused(place, ends):
    """A node inside a box with one spring along x, a skew one, or two: its stiffness is singular, up to rounding."""
    box = cubic(30.0, 20.0)
    nodes, k = np.vstack([box.positions, place]), box.n_nodes
    springs = [*map(tuple, box.springs.tolist()), *((end, k) for end in ends)]
    network = build_network(nodes, springs, stiffness=np.append(box.stiffness, [10.0] * len(ends)))
    with pytest.raises(NetworkError, match="without loose nodes, found one that moves without force"):
        effective_moduli(network)
    with pytest.raises(NetworkError, match="without loose nodes"):
        free_sided_young(spring_stiffness(network), nodes)


def test_a_network_in_the_plane_is_refused():
    with pytest.raises(NetworkError, match="expected a box in space, found dimension 2"):
        spring_stiffness(build_network([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]], [(0, 1), (1, 2), (0, 2)]))
