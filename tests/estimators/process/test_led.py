"""A tissue led along marks, against adaptive integration of what nobody leads."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dynamics import ImplicitStepper, Stepper, build_network
from estimators.process.led import Simulated, led_along

K, C, M, G = 40.0, 0.4, 0.05, 9.81
REST_M = 0.1


def three_in_a_row():
    """A mass between two others, an anchor aside so that a rest exists; all by equal springs, in a plane."""
    return build_network(
        ("anchor", "left", "middle", "right"),
        np.array([[0.0, 0.3], [-0.1, 0.0], [0.0, 0.0], [0.1, 0.0]]),
        [("anchor", "middle"), ("left", "middle"), ("middle", "right")],
        masses=M,
        gravity=[0.0, -G],
        stiffness=K,
        damping=C,
        rest_lengths=[0.3, REST_M, REST_M],
        fixed=("anchor",),
    )


def middle_by_hand(starts, ends, seconds, start):
    """The middle mass by its own equation of motion, its neighbours on straight lines: SciPy's DOP853."""
    anchor, rests = np.array([0.0, 0.3]), (0.3, REST_M, REST_M)

    def rate(t, state):
        place, velocity = state[:2], state[2:]
        force = np.array([0.0, -M * G])
        others = [(anchor, np.zeros(2))]
        others += [(a + (b - a) * t / seconds, (b - a) / seconds) for a, b in zip(starts, ends, strict=True)]
        for (at, speed), rest in zip(others, rests, strict=True):
            apart = at - place
            length = np.linalg.norm(apart)
            along = apart / length
            force = force + (K * (length - rest) + C * float((speed - velocity) @ along)) * along
        return np.r_[velocity, force / M]

    return solve_ivp(rate, (0.0, seconds), start, method="DOP853", rtol=1e-10, atol=1e-13).y[:, -1]


@pytest.mark.parametrize(("make", "within_m"), [(Stepper, 1e-7), (ImplicitStepper, 2e-5)])
def test_who_is_not_led_follows_by_the_equations(make, within_m):
    """Runge-Kutta of fourth order and TR-BDF2 of second, both in steps of at most 1/240 s, over 0.1 s."""
    network = three_in_a_row()
    now = Simulated(network.positions.copy(), np.zeros((4, 2)))
    starts = network.positions[[1, 3]]
    ends = starts + np.array([[0.02, 0.03], [-0.01, 0.02]])
    moved = led_along(make(network), now, 0.1, {1: ends[0], 3: ends[1]})
    truth = middle_by_hand(starts, ends, 0.1, np.zeros(4))
    np.testing.assert_allclose(moved.positions[2], truth[:2], rtol=0, atol=within_m)
    np.testing.assert_allclose(moved.velocities[2], truth[2:], rtol=0, atol=200.0 * within_m)


@pytest.mark.parametrize("make", [Stepper, ImplicitStepper])
def test_who_is_led_is_where_it_was_seen_and_as_fast_as_it_went(make):
    network = three_in_a_row()
    now = Simulated(network.positions.copy(), np.zeros((4, 2)))
    place = np.array([0.13, -0.02])
    moved = led_along(make(network), now, 0.05, {3: place})
    np.testing.assert_array_equal(moved.positions[3], place)
    np.testing.assert_allclose(moved.velocities[3], (place - [0.1, 0.0]) / 0.05, rtol=1e-9)
    assert np.abs(moved.positions[1] - network.positions[1]).max() > 1e-4  # nobody leads it, so it falls
    np.testing.assert_array_equal(moved.positions[0], network.positions[0])


def test_without_time_nodes_are_set_and_nothing_else_moves():
    network = three_in_a_row()
    now = Simulated(network.positions.copy(), 0.3 * np.ones((4, 2)))
    moved = led_along(ImplicitStepper(network), now, 0.0, {1: np.array([-0.2, 0.1])})
    np.testing.assert_array_equal(moved.positions[1], [-0.2, 0.1])
    np.testing.assert_array_equal(moved.positions[2:], now.positions[2:])
    np.testing.assert_array_equal(moved.velocities, now.velocities)
    np.testing.assert_array_equal(now.positions, network.positions)
