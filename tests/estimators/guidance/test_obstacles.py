"""Distances of needles from balls and capsules against the plainest oracle: many points."""

import numpy as np
import pytest

from estimators import Obstacle, ball, clearances


@pytest.mark.parametrize("dim", [2, 3])
def test_the_distance_is_that_of_the_closest_two_of_many_points(dim):
    """12 segments against one, 301 points on each: half a spacing of each off, 1 % of their lengths, at most."""
    rng = np.random.default_rng(dim)
    starts, ends = rng.normal(size=(2, 12, dim))
    a, b = rng.normal(size=(2, dim))
    part = np.linspace(0.0, 1.0, 301)[:, None]
    own = a + part * (b - a)
    found = clearances(starts, ends, [Obstacle("rib", a, b, 0.0)])[:, 0]
    for k in range(12):
        points = starts[k] + part * (ends[k] - starts[k])
        apart = np.linalg.norm(points[:, None] - own[None], axis=2).min()
        assert found[k] == pytest.approx(apart, abs=1e-2)
        assert found[k] <= apart + 1e-12


def test_radii_and_margins_take_from_the_room():
    """A needle of 1 mm beside a ball of 10 mm with 3 mm to spare, 20 mm from its centre: 6 mm are left."""
    start, end = np.array([[0.0, 0.1]]), np.array([[0.0, -0.1]])
    room = clearances(start, end, [ball("vessel", np.array([0.02, 0.0]), 0.01, 0.003)], 0.001)
    assert room == pytest.approx(np.array([[0.006]]))


def test_side_by_side_and_end_to_end():
    """Parallel segments, one behind the other on a line, and a crossing one: known distances."""
    start, end = np.zeros((1, 2)), np.array([[1.0, 0.0]])
    others = [
        Obstacle("beside", [0.2, 0.5], [0.8, 0.5], 0.0),
        Obstacle("behind", [1.3, 0.0], [2.0, 0.0], 0.0),
        Obstacle("across", [0.5, -1.0], [0.5, 1.0], 0.0),
    ]
    np.testing.assert_allclose(clearances(start, end, others), [[0.5, 0.3, 0.0]], atol=1e-12)


def test_no_obstacle_of_such_a_form():
    with pytest.raises(ValueError, match="rib: expected ends of one shape"):
        Obstacle("rib", [0.0, 0.0], [0.0, 0.0, 1.0], 0.01)
    with pytest.raises(ValueError, match="rib: expected a radius"):
        Obstacle("rib", [0.0, 0.0], [0.0, 1.0], -0.01)
