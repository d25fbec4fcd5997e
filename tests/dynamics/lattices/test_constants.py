"""Spring constants: published formulas, and factors fitted to the moduli of elements."""

import numpy as np
import pytest

from dynamics.lattices import (
    DIRECTIONS,
    Lattice,
    Sample,
    constants,
    directed,
    effective_moduli,
    effective_stiffness,
    fitted_factors,
    lattice_network,
    lattice_of,
    lloyd,
    orthotropic_moduli,
    plain,
    sheet,
    van_gelder,
    young_along,
)
from dynamics.mesh import TetMesh, Tissue
from dynamics.mesh.tissues import TISSUES

EDGE, YOUNG = 0.02, 5e3


def regular() -> Lattice:
    """One regular tetrahedron."""
    nodes = np.array([[1, 1, 1], [1, -1, -1], [-1, -1, 1], [-1, 1, -1.0]]) * EDGE / np.sqrt(8.0)
    springs = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
    return Lattice(TetMesh(nodes, np.array([[0, 1, 2, 3]])), springs, np.arange(6)[None], np.ones(4), np.ones(6))


def test_formulas_of_a_regular_tetrahedron():
    """E V / l², V = l³ / (6 sqrt 2) [vangelder1998]; 2 sqrt(2) / 25 E l [lloyd2007]."""
    young = np.array([YOUNG])
    np.testing.assert_allclose(van_gelder(regular(), young), YOUNG * EDGE / (6 * np.sqrt(2.0)), rtol=1e-12)
    np.testing.assert_allclose(lloyd(regular(), young), 2 * np.sqrt(2.0) / 25 * YOUNG * EDGE, rtol=1e-12)


def test_tetrahedra_add_up_by_their_own_moduli():
    lattice = lattice_of(sheet(np.random.default_rng(0)), 0.024, 6, np.random.default_rng(0))
    young = np.where(lattice.mesh.regions == 1, 96e3, 3e3)
    k = van_gelder(lattice, young)
    assert (k * lattice.lengths**2).sum() == pytest.approx(6 * (young * lattice.mesh.volumes).sum(), rel=1e-12)
    s = 100
    about = (lattice.edges == s).any(axis=1)
    assert k[s] == pytest.approx((young * lattice.mesh.volumes)[about].sum() / lattice.lengths[s] ** 2, rel=1e-12)


def test_a_factor_is_that_of_the_direction():
    """exp(f n_z⁴) and exp(f (n_x n_y)²)."""
    lattice = regular()
    n = (lattice.mesh.nodes[lattice.springs[:, 1]] - lattice.mesh.nodes[lattice.springs[:, 0]]) / EDGE
    np.testing.assert_allclose(
        directed(lattice, np.full(6, 3.0), np.array([0, 0, 0.5, 0, 0, 0])), 3 * np.exp(0.5 * n[:, 2] ** 4), rtol=1e-12
    )
    np.testing.assert_allclose(
        directed(lattice, np.ones(6), np.array([0, 0, 0, 0, 0, 2.0])), np.exp(2 * (n[:, 0] * n[:, 1]) ** 2), rtol=1e-12
    )


def boxed(structure, seed, tissues):
    """A sample of a lattice with the moduli of its elements, and those elements' moduli."""
    rng = np.random.default_rng(seed)
    lattice = lattice_of(structure(rng), 0.024, 6, rng)
    material = orthotropic_moduli(effective_stiffness(lattice.element_stiffness(tissues), lattice.mesh.nodes))
    first = van_gelder(lattice, lattice.of_elements(tissues, "young_pa"))
    return Sample(lattice, first, young_along(material.stiffness, DIRECTIONS)), material


def springs_of(sample, factors, tissues):
    k = directed(sample.lattice, sample.stiffness, factors)
    return effective_moduli(lattice_network(sample.lattice, k, tissues))


def test_fitted_springs_have_the_youngs_moduli_of_the_elements():
    tissues = [TISSUES["fat"], TISSUES["fascia"]]
    sample, _ = boxed(sheet, 0, tissues)
    before = young_along(springs_of(sample, np.zeros(6), tissues).stiffness, DIRECTIONS)
    assert np.abs(np.log(before / sample.young)).max() > 0.5
    found = springs_of(sample, fitted_factors([sample]), tissues)
    np.testing.assert_allclose(young_along(found.stiffness, DIRECTIONS), sample.young, rtol=1e-6)


@pytest.mark.parametrize(("poisson", "follows"), [(0.25, True), (0.49, False)])
def test_all_moduli_follow_at_a_poissons_ratio_of_a_quarter_alone(poisson, follows):
    """Factors of one box on another; central forces: shear modulus E / 2.5, bulk modulus E / 1.5."""
    tissues = [Tissue("own", YOUNG, poisson, 1000.0, 0.01)] * 2
    sample, material = boxed(plain, 0, tissues)
    other, _ = boxed(plain, 1, tissues)
    found = springs_of(other, fitted_factors([sample]), tissues)
    np.testing.assert_allclose(found.young, YOUNG, rtol=0.05)
    np.testing.assert_allclose(found.shear, YOUNG / 2.5, rtol=0.05)
    assert found.bulk == pytest.approx(YOUNG / 1.5, rel=0.15)
    assert found.poisson.max() < 0.26
    assert (found.bulk > 0.8 * material.bulk) == follows


def test_moduli_out_of_reach_are_an_error(monkeypatch):
    monkeypatch.setattr(constants, "STEPS", 2)
    sample, _ = boxed(plain, 0, [TISSUES["fat"]] * 2)
    with pytest.raises(ValueError, match="expected factors that meet the moduli, found none in 2 steps"):
        fitted_factors([sample._replace(young=100.0 * sample.young)])
