"""The paper's method against a truth that it is shown without noise."""

import numpy as np
import pytest

from dynamics import OUTER, integrate_adaptive, pack
from estimators import FilterSettings, MarkMeasurement, OpenLoop, Status
from tests.estimators.conftest import marks_of

SECONDS = 1.2


@pytest.fixture(scope="module")
def path(phantom, rest_state):
    """States at 960 frames/s under a smooth push of M3 and M1, by DOP853 to 1e-11 m."""

    def force(t):
        push = np.sin(np.pi * t / SECONDS) ** 2
        return push * np.array([[0.4, 0.3], [0.0, 0.0], [-1.2, 0.5], [0.0, 0.0]])

    times = np.linspace(0.0, SECONDS, 1153)
    return times, integrate_adaptive(phantom, rest_state, times, force=force, rtol=1e-10, atol=1e-12, max_step_s=0.02)


def followed(phantom, path, every, nodes=OUTER):
    """The method after being shown every so many states of the path, and the states it was shown."""
    loop, (times, states) = OpenLoop(phantom, "M2"), path
    shown = states[::every]
    means = np.array(
        [loop.update(t, marks_of(phantom, s, nodes=nodes)).mean for t, s in zip(times[::every], shown, strict=True)]
    )
    return loop, means, shown


def test_hidden_mass_converges_to_the_truth_to_second_order(phantom, path, hidden):
    """Marks move in straight lines between frames: they err by a dt²/8, and what they drive, too. Order within 0.1."""
    errors = []
    for every in (16, 8, 4, 2, 1):
        _, means, shown = followed(phantom, path, every)
        errors.append(np.abs(means - shown[:, hidden]).max())
    assert np.ptp(path[1][:, hidden], axis=0).max() > 0.01
    assert errors[-1] < 1e-6
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.min() >= 1.9
    assert orders.max() <= 2.1


def test_a_mark_lost_on_the_way_goes_on_with_the_speed_it_had(phantom, path):
    """Seen until 0.3 s at 120 frames/s, then not: it starts with the speed of the last straight piece."""
    times, states = path
    loop = OpenLoop(phantom, "M2")
    for k in range(0, 289, 8):
        loop.update(times[k], marks_of(phantom, states[k]))
    m3 = phantom.index("M3")
    speed = (states[288, 4:6] - states[280, 4:6]) / (times[288] - times[280])
    np.testing.assert_allclose(loop.velocities[m3], speed, rtol=0, atol=1e-12)
    before, dt = loop.positions[m3].copy(), 1e-4
    loop.update(times[288] + dt, [])
    np.testing.assert_allclose(loop.positions[m3] - before, speed * dt, rtol=0, atol=1e-7)  # a dt²/2, a under 20 m/s²


def test_with_all_marks_lost_it_is_the_free_simulation(phantom):
    """From any state, as `integrate_adaptive`. Steps of 1/240 s over 0.6 s: 20 µm, 1 mm/s of friction's bend."""
    rng = np.random.default_rng(0)
    start = phantom.positions[phantom.free] + 0.02 * rng.normal(size=(4, 2))
    speed = 0.3 * rng.normal(size=(4, 2))
    loop = OpenLoop(phantom, "M2")
    loop.update(5.0, [])
    loop.positions[phantom.free], loop.velocities[phantom.free] = start, speed
    times = np.array([0.0, 0.1, 0.25, 0.6])
    for t, expected in list(zip(times, integrate_adaptive(phantom, pack(start, speed), times), strict=True))[1:]:
        estimate = loop.update(5.0 + t, [])
        found = pack(loop.positions[phantom.free], loop.velocities[phantom.free])
        np.testing.assert_allclose(found[:8], expected[:8], rtol=0, atol=2e-5)
        np.testing.assert_allclose(found[8:], expected[8:], rtol=0, atol=1e-3)
        np.testing.assert_array_equal(estimate.mean, loop.positions[phantom.index("M2")])
        assert estimate.status is Status.COASTING
    np.testing.assert_array_equal(loop.positions[phantom.fixed], phantom.positions[phantom.fixed])


def test_marks_are_put_where_they_are_seen(phantom, path, rest_state):
    """To the bit, from the first frame on; all four masses may be marked."""
    states = path[1]
    loop = OpenLoop(phantom, "M2")
    for k, nodes in ((0, OUTER), (80, OUTER), (160, ("M1", "M2", "M3", "M4")), (240, ("M3",))):
        estimate = loop.update(path[0][k], marks_of(phantom, states[k], nodes=nodes))
        for node in nodes:
            np.testing.assert_array_equal(loop.positions[phantom.index(node)], states[k][phantom.coordinates(node)])
        assert (estimate.time_s, estimate.marks_used, estimate.status) == (path[0][k], len(nodes), Status.TRACKING)
        assert (estimate.cov, estimate.nis, estimate.poked) == (None, None, None)


def test_time_does_not_go_back(phantom):
    loop = OpenLoop(phantom, "M2")
    loop.update(1.0, [])
    with pytest.raises(ValueError, match=r"time_s: expected 1\.0 or later, found 0\.9"):
        loop.update(0.9, [])
    assert loop.time_s == 1.0


def test_marks_of_the_same_time_are_taken_in_too(phantom, rest_state):
    """What it counts as used and calls TRACKING must have been used: M1 seen 5 mm off in a second call for a time."""
    loop = OpenLoop(phantom, "M2")
    loop.update(1.0, [])
    seen = rest_state[phantom.coordinates("M1")] + 0.005
    estimate = loop.update(1.0, [MarkMeasurement("M1", seen, 1e-6 * np.eye(2))])
    assert estimate.marks_used == 1
    np.testing.assert_array_equal(loop.positions[phantom.index("M1")], seen)


@pytest.mark.parametrize("gap_s", [6.0, 86_400.0])
def test_it_goes_through_a_gap_as_through_five_seconds(phantom, rest_state, gap_s):
    """A gap of days costs no more than what the filter forgets after."""
    means = []
    for dt in (FilterSettings().forget_s, gap_s):
        loop = OpenLoop(phantom, "M2")
        loop.update(0.0, marks_of(phantom, rest_state + 0.02))
        estimate = loop.update(dt, marks_of(phantom, rest_state))
        assert estimate.time_s == dt
        means.append(estimate.mean)
    np.testing.assert_array_equal(*means)
