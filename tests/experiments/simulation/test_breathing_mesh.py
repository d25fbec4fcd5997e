"""Breathing of a whole mesh, against finite elements under a turn of gravity."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from dynamics.elements import continuum_network
from dynamics.mesh import Tissue, locate, lumped_masses, rest_stiffness
from experiments.errors import InputError
from experiments.formats.scenario import Breathing, Scenario, completed
from experiments.simulation.simulate import breathing_force
from tests.dynamics.blocks import block

POINTS = {
    name: np.array(place)
    for name, place in (("M1", [0.08, 0.04, 0.06]), ("M2", [0.02, 0.03, 0.06]), ("target", [0.041, 0.037, 0.032]))
}
BREATH = {"acceleration_m_s2": 3.0, "direction": [3.0, 0.0, 4.0], "shortest_s": 4.0, "longest_s": 4.0}
GEL = Tissue("gel", 4e3, 0.4, 1000.0, 0.02)


def test_breathing_without_nodes_accelerates_all_of_a_mesh():
    mesh = block((5, 5, 4), (0.08, 0.08, 0.06))
    held = np.flatnonzero(mesh.nodes[:, 2] < 1e-9)
    network = continuum_network(mesh, (GEL,), held, POINTS)
    scenario = Scenario(version=1, title="breath", duration_s=4.0, scene="x.toml", breathing=BREATH)
    breathing = completed(scenario, network, ("M1", "M2"), "x").breathing
    assert isinstance(breathing, Breathing)
    assert breathing.nodes is None
    force = breathing_force(network, breathing, np.random.default_rng(0))
    t = np.linspace(0.0, 4.0, 401)
    moved = np.array([np.linalg.solve(network.continuum.stiffness, force(at).ravel()) for at in t]).reshape(401, 3, 3)
    free = np.setdiff1d(np.arange(len(mesh.nodes)), held)
    body = np.outer(lumped_masses(mesh, GEL.density_kg_m3)[free], 3.0 * np.array([0.6, 0.0, 0.8]))
    rest = spsolve(rest_stiffness(mesh, GEL.young_pa, GEL.poisson, free), body.ravel()).reshape(-1, 3)
    everywhere = np.zeros_like(mesh.nodes)
    everywhere[free] = rest
    elements, within = locate(mesh, np.array(list(POINTS.values())))
    expected = np.einsum("kc,kcd->kd", within, everywhere[mesh.elements[elements]])
    waves = [moved[:, k] @ expected[k] / (expected[k] @ expected[k]) for k in range(3)]
    for k, wave in enumerate(waves):  # one wave for all points, along the way of each
        np.testing.assert_allclose(wave, waves[2], atol=0.05)
        np.testing.assert_allclose(moved[:, k], wave[:, None] * expected[k], atol=0.05 * np.abs(expected).max())
    amplitude = np.abs(np.fft.rfft(waves[2][:400])) / 200.0
    np.testing.assert_allclose(amplitude[1:3], [1.0, 0.5], atol=0.03)
    assert amplitude[3:].max() < 0.01


def test_a_mesh_that_nothing_holds_needs_nodes_to_breathe():
    network = continuum_network(block((2, 2, 2), (0.08, 0.08, 0.06)), (GEL,), np.empty(0, dtype=int), POINTS)
    scenario = Scenario(version=1, title="breath", duration_s=4.0, scene="x.toml", breathing=BREATH)
    with pytest.raises(InputError, match=r"x: breathing.nodes: expected nodes, for nothing holds the mesh, found none"):
        completed(scenario, network, ("M1", "M2"), "x")
