"""Chains and cables against the pendulum's period, its energy, the length of a rigid link and Hooke's law."""

import mujoco
import numpy as np
import pytest
from scipy.special import ellipk

from experiments.simulation.bodies import chains
from experiments.simulation.bodies.body import Scale
from experiments.simulation.bodies.chains import HINGE_N_M_S, LINK_N_M, MASSES_KG, _chain_xml, _stretch, cable, chain
from experiments.simulation.bodies.simulate import compiled, settled


@pytest.mark.parametrize("size", [0.1, 1.0, 10.0])
def test_one_link_swings_with_the_pendulums_period(size):
    """T = 4 K(sin²(a/2)) sqrt(l/g), a its amplitude; to 1 %: the hinge is damped a little, frames are 10 ms apart."""
    body = chain(1, 3, Scale(size=size), seconds=6.0 * np.sqrt(size))
    x, y = body.positions[:, 1].T
    angles = np.unwrap(np.arctan2(x, -y))
    amplitude = np.abs(angles).max()
    assert amplitude < np.pi
    rising = np.flatnonzero((angles[:-1] < 0.0) & (angles[1:] >= 0.0))
    crossings = body.times_s[rising] + 0.01 * -angles[rising] / (angles[rising + 1] - angles[rising])
    length = body.network.rest_lengths[0]
    period = 4.0 * ellipk(np.sin(0.5 * amplitude) ** 2) * np.sqrt(length / 9.81)
    assert crossings[1] - crossings[0] == pytest.approx(period, rel=0.01)


def test_two_links_keep_their_lengths_and_lose_what_their_hinges_take():
    """Energy then and now differ by the integral of c (turning of each hinge)²; rates by central differences."""
    body = chain(2, 0, Scale(size=10.0), seconds=3.0)
    steps = np.diff(body.positions, axis=1)
    lengths = np.linalg.norm(steps, axis=2)
    assert lengths == pytest.approx(np.tile(body.network.rest_lengths, (len(lengths), 1)), abs=1e-12)
    velocity = (body.positions[2:] - body.positions[:-2]) / 0.02
    masses = body.network.masses
    kinetic = 0.5 * (masses * (velocity**2).sum(axis=2)).sum(axis=1)
    energy = kinetic + 9.81 * (masses * body.positions[1:-1, :, 1]).sum(axis=1)
    links = np.unwrap(np.arctan2(steps[..., 0], -steps[..., 1]), axis=0)
    hinges = np.diff(links, axis=1, prepend=0.0)
    rates = (hinges[2:] - hinges[:-2]) / 0.02
    taken = np.cumsum((HINGE_N_M_S * 10.0**4.5 * rates**2).sum(axis=1)) * 0.01
    assert taken[-1] > 0.15 * np.ptp(kinetic)
    assert np.abs(energy[0] - energy - taken).max() < 0.01 * np.ptp(kinetic)


def test_links_of_a_scaled_chain_stretch_by_what_hangs_on_them():
    """Each link by the weight below it, m g / k."""
    scale = Scale(stiffness=0.1)
    lengths, masses = np.array([0.09, 0.07]), np.array(MASSES_KG[:2])
    model, data = compiled(_chain_xml(lengths, masses, 1e-5, _stretch("0 0 1", scale, 0.1 * LINK_N_M, 0.2)))
    settled(model, data, seconds=2.0, step_s=5e-4, kept=0.99)
    hanging = np.array([masses.sum(), masses[1]]) * 9.81 / (0.1 * LINK_N_M)
    ends = np.r_[0.0, -data.geom_xpos[:, 2]]
    assert np.diff(ends) - lengths == pytest.approx(hanging, rel=1e-3)


def test_segments_of_a_cable_keep_their_length_and_its_ends_their_places():
    body = cable(0, Scale(), 0.25, seconds=1.0)
    lengths = np.linalg.norm(np.diff(body.positions, axis=1), axis=2)
    assert lengths == pytest.approx(np.full_like(lengths, 0.1), abs=1e-9)
    assert np.abs(body.positions[:, 0]).max() == 0.0
    assert len(body.marked) == 9
    assert len(body.hidden) == 3
    assert body.led == ("n12",)


def test_a_soft_cable_stretches_as_the_springs_that_a_user_writes_down(monkeypatch):
    """Drawn straight and every link 1 mm longer: through each link its joint pulls as hard as all springs across it."""
    models = []
    monkeypatch.setattr(chains, "compiled", lambda xml: models.append(compiled(xml)) or models[-1])
    network = cable(0, Scale(stiffness=0.1), 0.25, seconds=0.1).network
    (model, _), (i, j) = models[0], network.springs.T
    longer = 1e-3 * (j - i)
    across = [(i <= link) & (j > link) for link in range(12)]
    pulls = [float(network.stiffness[own] @ longer[own]) for own in across]
    joints = model.jnt_stiffness[model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE]
    np.testing.assert_allclose(1e-3 * joints, pulls, rtol=1e-4)


def test_a_seed_makes_the_same_motion_again():
    first, again, other = (chain(2, seed, Scale(), seconds=0.2).positions for seed in (4, 4, 5))
    assert np.array_equal(first, again)
    assert np.abs(first - other).max() > 0.01
