"""The implicit step of assembled elements: order two against exact and adaptive truths, and no stiff oscillation."""

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import integrate_adaptive
from dynamics.elements import Assembly
from dynamics.integration.rosenbrock import Rosenbrock

LOOSE = 1e3
"""A tolerance that halves no step [m]."""


class LinearBody:
    """Three nodes in the plane with force -K x - C v: `ForceElement` of one element with three corners."""

    nodes = np.array([[0, 1, 2]])

    def __init__(self, K, C):
        self.K, self.C = K, C

    def energy(self, x):
        return np.array([0.5 * x.ravel() @ self.K @ x.ravel()])

    def force(self, x, v):
        return -(self.K @ x.ravel() + self.C @ v.ravel()).reshape(x.shape)

    def tangents(self, x, v):
        return self.K.reshape(1, 3, 2, 3, 2), self.C.reshape(1, 3, 2, 3, 2)

    def by_log_constants(self, x, v):
        return {}


@pytest.fixture
def linear():
    """A linear body with three accelerations that fade: its stepper of a tolerance, and its rate matrix."""
    rng = np.random.default_rng(1)
    root, loss = rng.normal(size=(2, 6, 6))
    K, C = 4.0 * root @ root.T + 2.0 * np.eye(6), 0.05 * loss @ loss.T
    masses, basis, fading = rng.uniform(0.5, 1.5, 6), rng.normal(size=(6, 3)), np.array([0.2, 0.5, 1.5])
    A = np.zeros((15, 15))
    A[:6, 6:12] = np.eye(6)
    A[6:12] = np.hstack([-K / masses[:, None], -C / masses[:, None], basis])
    A[12:, 12:] = -np.diag(1.0 / fading)
    assembly = Assembly(np.zeros((3, 2)), np.arange(3), [LinearBody(K, C)])
    return lambda tolerance_m: Rosenbrock(assembly, masses, basis, fading, tolerance_m), A


def end(stepper, state, dt, longest):
    return stepper.moves(state, dt, longest)[-1].state


def by_state(moves):
    """Derivative of the last state by the first, (n_state, n_state)."""
    total = np.eye(len(moves[0].state))
    for move in moves:
        step = np.zeros_like(total)
        half = len(move.by_state)
        step[:half] = move.by_state
        step[half:, half:] = np.diag(move.fading)
        total = step @ total
    return total


def is_second_order(errors):
    """Whether errors at steps each half the one before fall by four, to a tenth of the order."""
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    return np.all(np.abs(orders - 2.0) < 0.1)


def test_order_two_on_a_linear_body(linear):
    """Of the state, and of its derivative by the first one, which is that of the flow."""
    stepper, A = linear
    state, flow = np.random.default_rng(2).normal(size=15), expm(0.5 * A)
    errors, slopes = [], []
    for n in (64, 128, 256, 512):
        moves = stepper(LOOSE).moves(state, 0.5, 0.5 / n)
        assert [len(moves), moves[0].by_state.shape] == [n, (12, 15)]
        errors.append(np.abs(moves[-1].state - flow @ state).max())
        slopes.append(np.abs(by_state(moves) - flow).max())
    assert is_second_order(errors), errors
    assert is_second_order(slopes), slopes
    assert errors[-1] < 1e-4 * np.abs(flow @ state).max()


def test_without_derivatives_the_states_are_the_same(linear):
    stepper, _ = linear
    state = np.ones(15)
    with_them, without = (stepper(1e-4).moves(state, 0.2, 0.1, derivatives=wanted) for wanted in (True, False))
    assert len(with_them) == len(without)
    for one, other in zip(with_them, without, strict=True):
        np.testing.assert_array_equal(one.state, other.state)
        assert one.step_s == other.step_s
        assert other.by_state.size == 0


def test_a_step_is_halved_where_its_error_exceeds_the_tolerance(linear):
    """The stages differ by more than the step errs: one step from each state is off by less than the tolerance."""
    stepper, A = linear
    start, tolerance = np.random.default_rng(2).normal(size=15), 1e-3
    moves = stepper(tolerance).moves(start, 0.5, 0.5)
    steps = np.array([move.step_s for move in moves])
    np.testing.assert_allclose(steps.sum(), 0.5, rtol=1e-12)
    assert len(steps) > len(stepper(100 * tolerance).moves(start, 0.5, 0.5)) > 1
    assert len(stepper(LOOSE).moves(start, 0.5, 0.5)) == 1
    state = start
    for move in moves:
        error = np.abs((move.state - expm(move.step_s * A) @ state)[:6]).max()
        assert error < tolerance, move.step_s
        state = move.state


def test_steps_grow_again_where_the_motion_calms(build):
    """A spring heavily damped: fast at first, then hardly moving."""
    pair = build([[0.0, 0.0], [0.3, 0.0]], [[0, 1]], anchors=(0,), damping=4.0)
    stepper = stepper_of(pair, tolerance_m=1e-4)
    steps = [move.step_s for move in stepper.moves(np.array([0.3, 0, 5.0, 0, 0, 0]), 4.0, 0.25)]
    assert steps[0] < 0.04
    assert max(steps) == 0.25
    assert np.isclose(sum(steps), 4.0)


def test_no_step_is_shorter_than_its_share(linear):
    stepper, _ = linear
    moves = stepper(0.0).moves(np.ones(15), 0.5, 0.5)
    np.testing.assert_allclose([move.step_s for move in moves], 0.5 / 128, rtol=1e-12)
    assert len(moves) == 128


def test_a_state_that_is_not_finite_is_no_error(linear):
    stepper, _ = linear
    assert not np.isfinite(end(stepper(LOOSE), np.full(15, np.nan), 0.1, 0.1)).any()


def stepper_of(network, tolerance_m=LOOSE, fading_s=0.3):
    """All free coordinates have an acceleration of their own that fades."""
    masses = np.repeat(network.masses[network.free], network.dim)
    n = len(masses)
    return Rosenbrock(Assembly.of_network(network), masses, np.eye(n), np.full(n, fading_s), tolerance_m)


def test_a_stiff_spring_neither_grows_nor_rings(build):
    """1e8 N/m by 0.2 kg: a step of a 60th is 370 rad long, where the trapezoidal rule would ring for ever."""
    stiff = build([[0.0, 0.0], [0.3, 0.0]], [[0, 1]], anchors=(0,), stiffness=1e8)
    stretched = np.array([0.301, 0.0, 0.0, 0.0, 0.0, 0.0])
    moves = stepper_of(stiff).moves(stretched, 0.5, 1.0 / 60.0, derivatives=False)
    lengths = np.array([abs(move.state[0] - 0.3) for move in moves])
    assert lengths[0] < 0.02e-3
    assert np.all(lengths[1:] < 1e-6)
    speeds = np.array([np.abs(move.state[2:4]).max() for move in moves])
    assert speeds[-1] < 1e-6


def truth(network, state, seconds):
    """Coordinates and velocities after so long by DOP853, accelerations fading over 0.3 s."""
    n = network.n_state
    pull = network.masses[network.free, None] * state[n:].reshape(-1, network.dim)
    force = lambda t: pull * np.exp(-t / 0.3)  # noqa: E731
    return integrate_adaptive(network, state[:n], [0.0, seconds], force=force, rtol=1e-10)[-1]


def in_motion(network):
    """From where it is drawn, at half a metre a second, under accelerations of 3 m/s² on each coordinate."""
    rng, n = np.random.default_rng(4), len(network.free) * network.dim
    return np.concatenate([network.positions[network.free].ravel(), 0.5 * rng.normal(size=n), 3.0 * rng.normal(size=n)])


@pytest.mark.parametrize("dim", [2, 3])
def test_order_two_on_a_network_against_an_adaptive_integrator(tangled, dim):
    network = tangled(dim, friction=0.0)
    start, half = in_motion(network), 6 * dim
    expected = truth(network, start, 0.2)
    assert np.abs(expected - start[:half]).max() > 0.1
    ends = [end(stepper_of(network), start, 0.2, 0.2 / n)[:half] for n in (64, 128, 256)]
    errors = [np.abs(one - expected).max() for one in ends]
    assert is_second_order(errors), errors
    assert errors[-1] < 1e-3 * np.abs(expected).max()


def test_derivative_of_a_network_approaches_that_of_the_flow(tangled):
    """First order, for the slope of forces is that where a step begins."""
    network = tangled(2, friction=0.0)
    start, h = in_motion(network), 1e-4
    columns = [(truth(network, start + e, 0.1) - truth(network, start - e, 0.1)) / (2 * h) for e in h * np.eye(18)]
    exact = np.array(columns).T
    derivatives = [by_state(stepper_of(network).moves(start, 0.1, 0.1 / n))[:12] for n in (16, 32, 64)]
    errors = [np.abs(one - exact).max() for one in derivatives]
    assert np.all(np.array(errors[:-1]) / errors[1:] > 1.7), errors
    assert errors[-1] < 0.03 * np.abs(exact).max()
