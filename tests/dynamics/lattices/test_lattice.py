"""Lattices: a cube filled, springs along the structure, networks with mass and damping of their tissues."""

from functools import lru_cache

import numpy as np
import pytest

from dynamics.lattices import STRUCTURES, lattice_network, lattice_of, plain, van_gelder
from dynamics.mesh.tissues import TISSUES

SIDE = 0.024


@lru_cache
def made(name, seed=3, cells=8):
    rng = np.random.default_rng(seed)
    structure = STRUCTURES[name][0](rng)
    return structure, lattice_of(structure, SIDE, cells, rng), [TISSUES[one] for one in STRUCTURES[name][1]]


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_lattice_fills_its_cube(name):
    structure, lattice, _ = made(name)
    mesh = lattice.mesh
    assert mesh.volumes.sum() == pytest.approx(SIDE**3, rel=1e-4)
    np.testing.assert_allclose([mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)], [[0.0] * 3, [SIDE] * 3], atol=1e-12)
    within = structure(mesh.nodes[mesh.elements].mean(axis=1) / SIDE)
    np.testing.assert_array_equal(mesh.regions > 0, (within < 0.0).any(axis=0))
    ends = lattice.springs[lattice.edges]
    np.testing.assert_array_equal(np.sort(np.unique(ends[5])), np.sort(mesh.elements[5]))
    assert len(np.unique(np.sort(lattice.springs, axis=1), axis=0)) == len(lattice.springs)
    np.testing.assert_allclose(lattice.depths, SIDE * structure(mesh.nodes / SIDE).min(axis=0), atol=1e-12)


@pytest.mark.parametrize("name", [name for name in STRUCTURES if name != "plain"])
def test_springs_follow_the_structure(name):
    """Springs of a lattice that knows no structure cross its surfaces several times as often."""
    structure, lattice, _ = made(name)
    rng = np.random.default_rng(3)
    other = lattice_of(plain(rng), SIDE, 8, rng)
    depths = structure(other.mesh.nodes / SIDE).min(axis=0)
    crossing = (depths[other.springs].prod(axis=1) < 0.0).mean()
    assert lattice.crossing.mean() < 0.25 * crossing
    inside = np.unique(lattice.edges[lattice.mesh.regions > 0])
    assert lattice.alignment[inside].mean() > 2.0 / 3.0 + 0.03
    assert ((lattice.alignment > -1e-6) & (lattice.alignment < 1.0 + 1e-6)).all()


def test_alignment_is_that_of_layers():
    """The normal of flat layers is z."""
    flat = lattice_of(lambda x: np.abs(x[:, 2] - 0.5)[None] - 0.1, SIDE, 6, np.random.default_rng(0))
    apart = flat.mesh.nodes[flat.springs[:, 1]] - flat.mesh.nodes[flat.springs[:, 0]]
    expected = 1.0 - apart[:, 2] ** 2 / (apart**2).sum(axis=1)
    middle = flat.mesh.nodes[flat.springs].mean(axis=1)[:, 2]
    off = np.abs(middle - 0.5 * SIDE) > 0.01 * SIDE  # there the normal turns over
    np.testing.assert_allclose(flat.alignment[off], expected[off], atol=1e-6)
    assert flat.crossing.mean() < 0.02


def test_the_same_seed_makes_the_same_lattice():
    np.testing.assert_array_equal(made("foam")[1].mesh.nodes, made.__wrapped__("foam")[1].mesh.nodes)
    assert made("foam")[1].springs.shape != made("foam", seed=4)[1].springs.shape


def test_a_network_has_mass_and_damping_of_its_tissues():
    _, lattice, tissues = made("lobules")
    stiffness = van_gelder(lattice, lattice.of_elements(tissues, "young_pa"))
    network = lattice_network(lattice, stiffness, tissues)
    density = np.array([tissue.density_kg_m3 for tissue in tissues])[lattice.mesh.regions]
    assert network.masses.sum() == pytest.approx((density * lattice.mesh.volumes).sum(), rel=1e-12)
    np.testing.assert_allclose(network.damping, 0.01 * stiffness, rtol=1e-12)
    np.testing.assert_allclose(network.rest_lengths, lattice.lengths, rtol=1e-12)
