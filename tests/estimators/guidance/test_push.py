"""The push that advice predicts: that of equilibrium under the needle's force, less what the marks show already."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, node_weights, rest_shape
from estimators import Insertion, NeedlePush, PlannedNeedle, TargetPath

CUTTING = PlannedNeedle(cutting_N=0.2, friction_N_m=0.0, force_sd=0.3)


@pytest.fixture
def straight(phantom):
    """From 60 mm beside the target towards it."""
    place = phantom.positions[phantom.index(HIDDEN)]
    return Insertion(place + np.array([0.06, 0.0]), np.array([-1.0, 0.0]), 0.05)


def exact(phantom, tip, newtons, axis):
    """Where `rest_shape` has the target moved to, its force at the tip."""
    nodes = newtons * node_weights(phantom, tip, CUTTING.reach_m)[:, None] * axis
    return (rest_shape(phantom, nodes[phantom.free]) - rest_shape(phantom))[phantom.index(HIDDEN)]


def test_it_is_the_equilibrium_under_the_force_at_the_tip(phantom, straight):
    """5 % for what the linear answer leaves out."""
    moved = exact(phantom, straight.entry + 0.06 * straight.axis, 0.2, straight.axis)
    found = NeedlePush(phantom, HIDDEN, CUTTING).shift(straight)
    assert np.linalg.norm(moved) > 1e-3
    np.testing.assert_allclose(found, moved, rtol=0, atol=0.05 * np.linalg.norm(moved))


def test_what_a_needle_inside_has_pushed_is_not_added_again(phantom, straight):
    """Friction of 4 N/m on 20 mm less of the way, cutting all the way: at the target there is nothing left to add."""
    push = NeedlePush(phantom, HIDDEN, replace(CUTTING, friction_N_m=4.0))
    left = [np.linalg.norm(push.shift(replace(straight, depth_m=depth))) for depth in (0.0, 0.02, 0.04, 0.06)]
    assert left[0] > left[1] > left[2] > left[3] == 0.0


def test_nothing_is_pushed_without_force_behind_the_needle_or_where_nothing_holds(phantom, straight):
    free = replace(phantom, fixed=np.zeros(phantom.n_nodes, dtype=bool))
    away = replace(straight, axis=-straight.axis)
    for network, needle, insertion in (
        (phantom, replace(CUTTING, cutting_N=0.0), straight),
        (phantom, CUTTING, away),
        (free, CUTTING, straight),
    ):
        assert NeedlePush(network, HIDDEN, needle).shift(insertion).tolist() == [0.0, 0.0]


def test_the_path_moves_by_it_and_is_as_uncertain_as_the_force(phantom, straight):
    """30 % of the force is 30 % of the shift, along it."""
    push, cov = NeedlePush(phantom, HIDDEN, CUTTING), 1e-6 * np.eye(2)
    path = TargetPath(np.array([0.0, 1.0]), np.zeros((2, 2)), np.tile(cov, (2, 1, 1)))
    shift, pushed = push.shift(straight), push.pushed(path, straight)
    np.testing.assert_allclose(pushed.means, [shift, shift])
    np.testing.assert_allclose(pushed.covs[0], cov + 0.09 * np.outer(shift, shift))
