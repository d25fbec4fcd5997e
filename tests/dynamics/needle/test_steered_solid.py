"""A continuum under a steered needle: at rest against its stiffness, in motion against SciPy's integrator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dynamics import (
    NeedleMechanics,
    NeedleMotion,
    NeedlePose,
    SampledForces,
    advance_steered,
    needle_load,
    node_weights,
    steady_state,
)
from dynamics.elements import continuum_network
from dynamics.mesh import Tissue
from dynamics.needle import steered
from tests.dynamics.blocks import block

FAT = Tissue("fat", 3e3, 0.4, 950.0, 0.03)
POINTS = {
    "M1": np.array([0.02, 0.02, 0.04]),
    "M2": np.array([0.06, 0.04, 0.04]),
    "entry": np.array([0.04, 0.03, 0.04]),
    "target": np.array([0.04, 0.03, 0.02]),
}
DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def network():
    mesh = block((8, 6, 4), (0.08, 0.06, 0.04))
    return continuum_network(mesh, (FAT,), np.flatnonzero(mesh.nodes[:, 2] < 1e-9), POINTS)


def needle(**constants):
    still = NeedlePose(POINTS["entry"], DOWN, 0.0, 0.0)
    return NeedleMechanics(lambda _t: still, POINTS["entry"], reach_m=2e-3, **constants)


def rest(network):
    return steady_state(network, network.positions[network.free])


def held(force):
    return SampledForces(np.array([force, force]), 1.0)


def moved(network, state, tool, motion, outside, until_s, punctured=False):
    return advance_steered(network, tool, state, motion, outside=outside, between_s=(0.0, until_s), punctured=punctured)


AWAY = NeedleMotion(POINTS["entry"], np.zeros(3), DOWN, -1.0)


def test_forces_that_last_displace_it_by_its_compliance(network):
    """K u = F: with modes for half of it, and the residual flexibility; and it stays there."""
    force = np.random.default_rng(0).normal(0.0, 0.02, (4, 3))
    shift = np.linalg.solve(network.continuum.stiffness, force.ravel())
    by_modes = (network.continuum.shapes / network.continuum.rates) @ network.continuum.shapes.T @ force.ravel()
    assert np.abs(shift - by_modes / network.continuum.mass).max() > 0.2 * np.abs(shift).max()
    drawn = network.positions[network.free].ravel()
    state, _ = moved(network, rest(network), needle(), AWAY, held(force), 3.0)
    np.testing.assert_allclose(state[:12] - drawn, shift, atol=1e-8)
    np.testing.assert_allclose(state[12:24], 0.0, atol=1e-8)
    there = steady_state(network, (drawn + shift).reshape(-1, 3))
    np.testing.assert_allclose(there[:12], state[:12], atol=1e-8)
    after, _ = moved(network, there, needle(), AWAY, held(force), 0.1)
    np.testing.assert_allclose(after[:12], there[:12], atol=1e-8)


def test_a_needle_at_rest_dents_the_skin_against_its_compliance(network):
    """F = k (d - c F): contact k, depth d, and c the compliance of the skin at the entry."""
    solid, k, d = network.continuum, 50.0, 5e-3
    part = node_weights(network, POINTS["entry"], 2e-3)[network.free]
    along = np.outer(part, DOWN).ravel()
    c = along @ np.linalg.solve(solid.stiffness, along)
    force = k * d / (1.0 + k * c)
    assert k * c > 1.0
    tool, still = needle(contact_N_m=k, puncture_N=1e3), NeedleMotion(POINTS["entry"], np.zeros(3), DOWN, d)
    nothing = held(np.zeros((4, 3)))
    state, _ = moved(network, rest(network), tool, still, nothing, 3.0)
    shift = np.linalg.solve(solid.stiffness, force * along)
    np.testing.assert_allclose(state[:12] - network.positions[network.free].ravel(), shift, atol=1e-7)
    for most, gives_way in ((1.01, False), (0.99, True)):
        assert moved(network, state, replace(tool, puncture_N=most * force), still, nothing, 0.1)[1] == gives_way


def test_an_insertion_is_that_of_scipy(network):
    """0.3 s at 50 mm/s through punctured skin under a force that swings: q'' + c q' + w q = B F, by LSODA."""
    solid, n = network.continuum, network.n_state
    t = np.linspace(0.0, 0.3, 301)
    forces = np.zeros((len(t), 4, 3))
    forces[:, 0, 0] = 0.05 * np.sin(20.0 * t)

    def pose(now):
        return NeedlePose(POINTS["entry"] + 0.05 * now * DOWN, DOWN, 0.05, 0.05 * now)

    tool = needle(cutting_N=0.1, friction_N_m=5.0)
    sliding, r = replace(tool, pose=pose), len(solid.rates)

    def acting(now, speeds):
        x, v = network.positions, np.zeros_like(network.positions)
        v[network.free] = (solid.shapes @ speeds).reshape(-1, 3)
        own = needle_load(network, sliding, now, x, v, punctured=True).nodes[network.free]
        own[0, 0] += np.interp(now, t, forces[:, 0, 0])
        return own.ravel()

    def rate(now, y):
        q, s = y[:r], y[r:]
        return np.concatenate([s, solid.shapes.T @ acting(now, s) / solid.mass - solid.damping * s - solid.rates * q])

    exact = solve_ivp(rate, (0.0, 0.3), np.zeros(2 * r), method="LSODA", rtol=1e-6, atol=1e-9, max_step=5e-3)
    q, s = exact.y[:r, -1], exact.y[r:, -1]
    residual = np.linalg.inv(solid.stiffness) - (solid.shapes / solid.rates) @ solid.shapes.T / solid.mass
    places = network.positions[network.free].ravel() + solid.shapes @ q + residual @ acting(0.3, s)
    motion = NeedleMotion(POINTS["entry"], 0.05 * DOWN, DOWN, 0.0)
    state, _ = moved(network, rest(network), tool, motion, SampledForces(forces, 1e-3), 0.3, punctured=True)
    target = network.coordinates("target")
    assert np.linalg.norm(state[target] - POINTS["target"]) > 1e-3
    np.testing.assert_allclose(state[:12], places, atol=5e-6)
    np.testing.assert_allclose(state[12:n], solid.shapes @ s, atol=5e-4)


def test_a_slow_and_a_stopped_needle_follow_steps_eight_times_finer(monkeypatch):
    """At 3 mm/s, and stopped after 0.1 s at 50 mm/s: the target to 10 µm at every frame, 5 µm at the last."""
    mesh = block((8, 6, 4), (0.08, 0.06, 0.04))
    held_nodes = np.flatnonzero(mesh.nodes[:, 2] < 1e-9)
    network = continuum_network(mesh, (FAT,), held_nodes, POINTS, left_out=0.0)
    target, nothing, frame_s = network.coordinates("target"), held(np.zeros((4, 3))), 1.0 / 30.0

    def track(step_s, speed, stops):
        monkeypatch.setattr(steered, "SOLID_STEP", step_s)
        steered.longest_step.cache_clear()
        state, depth, found = rest(network), 0.01, []
        for k in range(8):
            now = speed if k < stops else 0.0
            motion = NeedleMotion(POINTS["entry"] + depth * DOWN, now * DOWN, DOWN, depth)
            state, _ = moved(network, state, needle(), motion, nothing, frame_s, punctured=True)
            depth += now * frame_s
            found.append(state[target])
        return np.array(found)

    step_s = steered.SOLID_STEP
    for speed, stops in ((3e-3, 8), (0.05, 3)):
        found, exact = (track(each, speed, stops) for each in (step_s, step_s / 8.0))
        off = np.linalg.norm(found - exact, axis=1)
        assert np.linalg.norm(exact[-1] - POINTS["target"]) > 5e-4
        assert off.max() < 1e-5
        assert off[-1] < 5e-6


def test_sampled_forces_are_two_or_more():
    with pytest.raises(ValueError, match="sampled forces: expected two times or more, found 1"):
        SampledForces(np.zeros((1, 4, 3)), 1.0)
