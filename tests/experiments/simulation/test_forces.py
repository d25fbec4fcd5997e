"""Forces of scenarios: on a whole mesh against finite elements, on a mass on a spring against its rest."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.sparse.linalg import spsolve

from dynamics import four_mass_phantom
from dynamics.elements import continuum_network
from dynamics.mesh import Tissue, locate, lumped_masses, rest_stiffness
from experiments.errors import InputError
from experiments.formats.scenario import Scenario, completed
from experiments.formats.scenario_forces import Breathing
from experiments.simulation.forces import breathing_force, posture_force
from experiments.simulation.simulate import true_motion
from tests.dynamics.blocks import block
from tests.experiments.rows import complaint

POINTS = {
    name: np.array(place)
    for name, place in (("M1", [0.08, 0.04, 0.06]), ("M2", [0.02, 0.03, 0.06]), ("target", [0.041, 0.037, 0.032]))
}
BREATH = {"acceleration_m_s2": 3.0, "direction": [3.0, 0.0, 4.0], "shortest_s": 4.0, "longest_s": 4.0}
GEL = Tissue("gel", 4e3, 0.4, 1000.0, 0.02)


@pytest.fixture(scope="module")
def gel():
    """A block of gel on a table: mesh, nodes that are held, network."""
    mesh = block((5, 5, 4), (0.08, 0.08, 0.06))
    held = np.flatnonzero(mesh.nodes[:, 2] < 1e-9)
    return mesh, held, continuum_network(mesh, (GEL,), held, POINTS)


def accelerated(mesh, held, acceleration):
    """Displacement of the points by finite elements where all of the mass is accelerated, (3, 3) [m]."""
    free = np.setdiff1d(np.arange(len(mesh.nodes)), held)
    body = np.outer(lumped_masses(mesh, GEL.density_kg_m3)[free], acceleration)
    everywhere = np.zeros_like(mesh.nodes)
    everywhere[free] = spsolve(rest_stiffness(mesh, GEL.young_pa, GEL.poisson, free), body.ravel()).reshape(-1, 3)
    elements, within = locate(mesh, np.array(list(POINTS.values())))
    return np.einsum("kc,kcd->kd", within, everywhere[mesh.elements[elements]])


def scenario_of(network, **tables):
    given = Scenario(version=1, duration_s=8.0, frame_interval_s=0.1, scene="x.toml", **tables)
    return completed(given, network, ("M1", "M2"), "x")


def test_breathing_without_nodes_accelerates_all_of_a_mesh(gel):
    mesh, held, network = gel
    scenario = Scenario(version=1, title="breath", duration_s=4.0, scene="x.toml", breathing=BREATH)
    breathing = completed(scenario, network, ("M1", "M2"), "x").breathing
    assert isinstance(breathing, Breathing)
    assert breathing.nodes is None
    force = breathing_force(network, breathing, np.random.default_rng(0))
    t = np.linspace(0.0, 4.0, 401)
    moved = np.array([np.linalg.solve(network.continuum.stiffness, force(at).ravel()) for at in t]).reshape(401, 3, 3)
    expected = accelerated(mesh, held, 3.0 * np.array([0.6, 0.0, 0.8]))
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
    assert "x: breathing.nodes: expected nodes, as the mesh has no anchors, found none" in complaint(
        completed, scenario, network, ("M1", "M2"), "x"
    )


def test_a_mesh_whose_posture_changes_hangs_by_the_new_gravity(gel):
    mesh, held, network = gel
    turned = scenario_of(network, posture={"from_m_s2": [0, 0, -9.81], "to_m_s2": [-9.81, 0, 0]})
    truth = true_motion(network, turned, np.random.default_rng(0)).positions
    moved = truth - network.positions[network.free]
    np.testing.assert_allclose(moved[:10], 0.0, atol=1e-9)
    expected = accelerated(mesh, held, np.array([-9.81, 0.0, 9.81]))
    np.testing.assert_allclose(moved[-1], expected, atol=0.02 * np.abs(expected).max())
    assert np.abs(expected).max() > 0.005


def test_gravity_keeps_its_size_while_it_turns():
    network = four_mass_phantom()
    posture = scenario_of(network, posture={"to_m_s2": [4.905, -8.496], "start_s": 1.0, "lasts_s": 4.0}).posture
    force = posture_force(network, posture)
    found = [network.gravity + force(t)[0] / network.masses[network.free[0]] for t in (0.0, 3.0, 7.0)]
    half = np.radians(15.0)
    expected = 9.81 * np.array([[0.0, -1.0], [np.sin(half), -np.cos(half)], [0.5, -np.sqrt(0.75)]])
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_a_plate_displaces_its_nodes_while_it_presses(gel):
    network = gel[2]
    press = {"nodes": ["M1", "M2"], "force_n": [0.0, 0.0, -0.4], "lasts_s": 3.0}
    truth = true_motion(network, scenario_of(network, press=[press]), np.random.default_rng(0)).positions
    moved = truth - network.positions[network.free]
    each = np.zeros((3, 3))
    each[:2, 2] = -0.2
    expected = np.linalg.solve(network.continuum.stiffness, each.ravel()).reshape(3, 3)
    np.testing.assert_allclose(moved[34], expected, atol=0.02 * np.abs(expected).max())
    np.testing.assert_allclose(moved[[0, 9, -1]], 0.0, atol=0.02 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"posture": {"to_m_s2": [0, 9.81, 0]}}, "x: posture.from_m_s2: expected a non-zero vector .*found zero"),
        ({"posture": {"from_m_s2": [0, -9.81], "to_m_s2": [0, 9.81, 0]}}, "x: posture.from_m_s2: expected 3 numbers"),
        ({"posture": {"from_m_s2": [0, 0, 1], "to_m_s2": [0, 0, -9.81]}}, "x: posture.to_m_s2: expected less"),
        ({"press": [{"nodes": ["M3"], "force_n": [0, 0, 1]}]}, r"x: press\[0\].nodes\[0\]: no node named"),
        ({"press": [{"nodes": ["M1"], "force_n": [0, 1]}]}, r"x: press\[0\].force_n: expected 3 numbers"),
        ({"press": [{"nodes": ["M1"], "force_n": [0, 0, 0]}]}, "force_n: expected a non-zero vector, found zero"),
        ({"press": [{"nodes": ["M1"], "force_n": [0, 0, 1], "rises_s": 3}]}, "expected at most half of lasts_s"),
        ({"press": [{"nodes": ["M1", "M1"], "force_n": [0, 0, 1]}]}, "expected different nodes, found one twice"),
    ],
)
def test_what_does_not_fit_the_tissue_is_an_error(gel, tables, message):
    with pytest.raises((InputError, ValidationError), match=message):
        scenario_of(gel[2], **tables)
