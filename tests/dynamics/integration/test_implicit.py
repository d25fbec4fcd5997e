"""Implicit steps against adaptive integration, rigid links and finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from dynamics import DRIVEN, ImplicitStepper, MassSpringNetwork, Stepper, integrate_adaptive, stiffness_matrix
from dynamics.forces.kernels import implicit_steps, packed, tangents_each
from dynamics.forces.tangent import damping_matrix
from tests.networks import build_network

LENGTH, G = 0.1, 9.81


def link(stiffness: float) -> MassSpringNetwork:
    """A mass that hangs from an anchor by one spring."""
    changes = {"masses": 0.012, "stiffness": stiffness, "damping": 0.5, "gravity": [0.0, -G]}
    return build_network([[0.0, 0.0], [0.0, -LENGTH]], [(0, 1)], [0], **changes)


@pytest.fixture(scope="module")
def smooth(phantom):
    """The phantom without friction, whose bend over 5 mm/s makes an error of its own."""
    return replace(phantom, friction=np.zeros(phantom.n_nodes))


@pytest.fixture(scope="module")
def slack(smooth):
    """Weightless, and drawn where no spring is stretched."""
    ends = smooth.positions[smooth.springs]
    return replace(smooth, rest_lengths=np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), gravity=np.zeros(2))


def moving(network, seed=3):
    rng = np.random.default_rng(seed)
    drawn = network.positions[network.free].ravel()
    return np.r_[1.03 * drawn, 0.2 * rng.normal(size=drawn.size)]


def test_steps_are_of_second_order(smooth):
    """Half the step, a quarter of the error: against DOP853 under a constant force, over 0.1 s."""
    start, force = moving(smooth), 0.05 * np.arange(8.0)
    truth = integrate_adaptive(smooth, start, [0.0, 0.1], force=lambda _t: force.reshape(-1, 2))[-1]
    masses = np.repeat(smooth.masses[smooth.free], 2)
    errors = []
    for n in (16, 32, 64):
        own = (start[None], force[None], 0.1 / n, n, True, smooth.positions, smooth.free, masses, packed(smooth))
        errors.append(np.abs(implicit_steps(*own)[0] - truth)[:8].max())
    assert errors[2] < 5e-5
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 4.0, atol=0.6)


@pytest.mark.parametrize("stiffness", [2e3, 2e5, 2e7])
def test_a_stiff_link_swings_like_a_rigid_one(stiffness):
    """However stiff the link: a pendulum let go at 1 rad, by its angle's equation, over half a second."""
    network = link(stiffness)
    swung = solve_ivp(lambda _t, y: [y[1], -G / LENGTH * np.sin(y[0])], (0.0, 0.5), [1.0, 0.0], rtol=1e-10).y[0, -1]
    stepper, state = ImplicitStepper(network), np.array([[np.sin(1.0), -np.cos(1.0), 0.0, 0.0]]) * LENGTH
    for _ in range(50):
        state = stepper.advance(state, 0.01, np.zeros((1, 2)))
    # a link of 2,000 N/m stretches by 0.1 mm; steps of 4 ms err by some 0.1 mm
    np.testing.assert_allclose(state[0, :2], LENGTH * np.array([np.sin(swung), -np.cos(swung)]), rtol=0, atol=0.5e-3)


def test_transition_matrices_are_derivatives_of_what_steps_do(slack):
    """By central differences of `advance` about a rest without tensions, where tangents are those of all steps."""
    stepper, dt, eps = ImplicitStepper(slack), 1 / 30, 1e-7
    start = np.r_[slack.positions[slack.free].ravel(), np.zeros(8)]
    found = stepper.linearised(start[None], dt)
    none = np.zeros((16, 8))
    by_state = stepper.advance(start + eps * np.eye(16), dt, none) - stepper.advance(start - eps * np.eye(16), dt, none)
    np.testing.assert_allclose(found.F[0], by_state.T / (2 * eps), rtol=0, atol=1e-5 * np.abs(found.F).max())
    at, force = np.tile(start, (8, 1)), eps * np.eye(8)
    by_force = stepper.advance(at, dt, force) - stepper.advance(at, dt, -force)
    np.testing.assert_allclose(
        found.by_force[0], by_force.T / (2 * eps), rtol=0, atol=1e-5 * np.abs(found.by_force).max()
    )


def test_a_driven_node_keeps_its_velocity_in_the_matrices_too(slack):
    """Of the node nothing but its own velocity matters; the others as by central differences of `advance`, at rest."""
    stepper, dt, eps, driven = ImplicitStepper(slack), 1 / 30, 1e-7, [int(slack.free[1])]
    start = np.r_[slack.positions[slack.free].ravel(), np.zeros(8)]
    found = stepper.linearised(start[None], dt, driven=driven)
    ahead, behind = (stepper.advance(start + sign * eps * np.eye(16), dt, driven=driven) for sign in (1.0, -1.0))
    np.testing.assert_allclose(found.F[0], (ahead - behind).T / (2 * eps), rtol=0, atol=1e-5 * np.abs(found.F).max())
    own, free = [2, 3, 10, 11], np.zeros((4, 16))
    free[range(4), own] = 1.0
    free[[0, 1], [10, 11]] = dt
    np.testing.assert_allclose(found.F[0][own], free, rtol=0, atol=1e-9)
    mass = float(slack.masses[driven[0]])
    expected = mass * DRIVEN * found.by_force[0][:, 2]
    np.testing.assert_allclose(expected[own], [0.5 * dt**2, 0.0, dt, 0.0], rtol=0, atol=1e-9)
    reached = stepper.advance(start[None], dt, mass * DRIVEN * eps * np.eye(8)[2:3], driven=driven)[0] - start
    np.testing.assert_allclose(expected, reached / eps, rtol=0, atol=1e-5)


def test_a_half_step_twice_is_the_whole(smooth):
    """`half` squared is F: the matrices of both halves of a step are those of one state."""
    found = ImplicitStepper(smooth).linearised(moving(smooth)[None], 1 / 30)
    np.testing.assert_allclose(found.half @ found.half, found.F, rtol=0, atol=1e-12 * np.abs(found.F).max())


def test_a_compressed_link_does_not_grow():
    """A link pressed to half its length is an unstable rest; in its matrix no motion grows but a straight one."""
    pressed = np.array([[0.0, -0.5 * LENGTH, 0.0, 0.0]])
    network = link(2000.0)
    assert np.linalg.eigvalsh(stiffness_matrix(network, [[0, 0], [0, -0.5 * LENGTH]]))[0] < -1000.0
    F = ImplicitStepper(network).linearised(pressed, 1 / 30).F[0]
    assert np.abs(np.linalg.eigvals(F)).max() <= 1.0 + 1e-9


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([2, 3]))
def test_tangents_are_semidefinite_and_exact_where_nothing_is_compressed(seed, dim):
    """For random shapes of a random network; those of stretched springs are the derivatives that `tangent.py` has."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(-1.0, 1.0, (5, dim))
    springs = np.array([(i, j) for i in range(5) for j in range(i)])
    lengths = np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1)
    changes = {"drag": rng.uniform(0.0, 1.0, 5), "stiffness": rng.uniform(1.0, 100.0, 10)}
    changes |= {"rest_lengths": lengths * rng.uniform(0.5, 0.99, 10), "damping": rng.uniform(0.0, 1.0, 10)}
    network = build_network(positions, springs, [0], **changes)
    state = np.r_[positions[1:].ravel(), rng.normal(size=4 * dim)]
    own = network.positions, network.free, packed(network)
    for definite in (False, True):
        K, C = tangents_each(state[None], definite, *own)
        np.testing.assert_allclose(K[0], stiffness_matrix(network, positions), rtol=0, atol=1e-9)
        np.testing.assert_allclose(C[0], damping_matrix(network, positions), rtol=0, atol=1e-9)
    state[: 4 * dim] = 0.3 * rng.normal(size=4 * dim)
    K, _ = tangents_each(state[None], True, *own)
    assert np.linalg.eigvalsh(K[0])[0] > -1e-9
    moved = positions.copy()
    moved[1:] = state[: 4 * dim].reshape(4, dim)
    K, _ = tangents_each(state[None], False, *own)
    np.testing.assert_allclose(K[0], stiffness_matrix(network, moved), rtol=0, atol=1e-9)


def test_steps_are_a_power_of_two_and_no_longer_than_those_of_the_filter(smooth):
    """So that transition matrices of a step can be squared."""
    stepper = ImplicitStepper(smooth)
    times = {1e-4: 1, 1 / 240: 1, 1 / 240 + 1e-12: 1, 1 / 100: 4, 1 / 30: 8, 1.0: 256}
    assert {dt: stepper.n_steps(dt) for dt in times} == times


def test_many_states_move_as_each_does_alone(smooth):
    """A batch is each of its states: no scratch of one reaches the next. To the last bit."""
    stepper, states = ImplicitStepper(smooth), np.array([moving(smooth, seed) for seed in range(3)])
    together = stepper.advance(states, 1 / 50, np.zeros((3, 8)))
    alone = [stepper.advance(state[None], 1 / 50, np.zeros((1, 8)))[0] for state in states]
    np.testing.assert_array_equal(together, alone)
    assert np.abs(Stepper(smooth).advance(states, 1 / 50) - together)[:, :8].max() < 1e-4


def cloth() -> MassSpringNetwork:
    """A lattice of 5 x 6 nodes 50 mm apart that hangs from its upper edge: too large for tangents at each iteration."""
    positions = 0.05 * np.array([(column, 0.0, -row) for row in range(5) for column in range(6)])
    apart = np.linalg.norm(positions[:, None] - positions, axis=2)
    springs = np.argwhere(np.triu((apart > 0.0) & (apart < 0.08)))
    changes = {"masses": 1e-3 / 3.0, "stiffness": 60.0, "damping": 0.1, "gravity": [0.0, 0.0, -G]}
    return build_network(positions, springs, range(6), **changes)


def test_a_crumpled_cloth_does_not_fly_apart():
    """Nodes 20 mm off and at 4 m/s go 90 to 120 mm within 1/30 s: to 60 mm of DOP853's, damped, but not beyond."""
    network, rng = cloth(), np.random.default_rng(4)
    drawn = network.positions[network.free]
    state = np.r_[(drawn + rng.normal(0.0, 0.02, drawn.shape)).ravel(), rng.normal(0.0, 4.0, drawn.size)]
    moved = ImplicitStepper(network).advance(state[None], 1.0 / 30.0, np.zeros((1, drawn.size)))[0]
    exact = integrate_adaptive(network, state, [0.0, 1.0 / 30.0])[-1]
    assert np.abs(moved - exact)[: drawn.size].max() < 0.06
