"""What constants that are off make of the error: against motions and rest shapes of networks that have them so."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import OUTER, independent_uncertainty, parameters, rest_shape, scale_parameters
from estimators import ForceMode, TissueModel
from tests.networks import build_network

SMALL = 1e-3
"""Relative change of a constant: its second order is a thousandth of its first."""


def test_columns_of_a_rest_shape_are_those_of_other_rest_shapes(phantom):
    """d(rest)/d(log constant) by central differences of `rest_shape`. 1e-5 of it."""
    which = parameters(phantom, ("stiffness", "rest_length"))
    found = TissueModel(phantom, OUTER, uncertainty=independent_uncertainty(which, 1.0)).resting_columns(
        phantom.positions
    )
    for k in range(len(which)):
        shapes = [rest_shape(scale_parameters(phantom, which[k : k + 1], [sign * SMALL])) for sign in (1.0, -1.0)]
        moved = (shapes[0] - shapes[1])[phantom.free].ravel() / (2.0 * SMALL)
        np.testing.assert_allclose(found[:8, k], moved, rtol=0, atol=1e-5 * max(np.abs(moved).max(), 1e-3))
    assert np.abs(found[8:]).max() == 0.0


def test_a_body_without_anchors_rests_in_the_shape_of_its_lengths_where_it_was():
    """A triangle of springs is rigid: each length alone changes by its error; nothing is moved or turned."""
    corners, springs = np.array([[0.0, 0.0], [0.03, 0.0], [0.0, 0.04]]), np.array([[0, 1], [1, 2], [2, 0]])
    lengths = np.array([0.03, 0.05, 0.04])
    constants = {"masses": 0.02, "stiffness": [50.0, 20.0, 90.0], "rest_lengths": lengths}
    triangle = build_network(corners, springs, names="abc", **constants)
    uncertain = independent_uncertainty(parameters(triangle, ("stiffness", "rest_length")), 0.01)
    columns = TissueModel(triangle, ("a",), uncertainty=uncertain).resting_columns(corners)
    np.testing.assert_allclose(columns[:, :3], 0.0, atol=1e-15)
    assert np.abs(columns[6:]).max() == 0.0
    for k, made in enumerate(columns[:6, 3:].T.reshape(3, 3, 2)):
        along = (corners[springs[:, 1]] - corners[springs[:, 0]]) / lengths[:, None]
        longer = np.einsum("ki,ki->k", along, made[springs[:, 1]] - made[springs[:, 0]])
        np.testing.assert_allclose(longer, 0.01 * lengths * (np.arange(3) == k), rtol=0, atol=1e-15)
        np.testing.assert_allclose(made.sum(axis=0), 0.0, atol=1e-15)
        assert np.sum(corners[:, 0] * made[:, 1] - corners[:, 1] * made[:, 0]) == pytest.approx(0.0, abs=1e-16)


def test_damping_moves_no_rest_shape(phantom):
    model = TissueModel(
        phantom, OUTER, uncertainty=independent_uncertainty(parameters(phantom, ("damping", "drag")), 1.0)
    )
    assert np.abs(model.resting_columns(phantom.positions)).max() == 0.0


def test_modes_move_together_as_they_do_alone(phantom, rest_state):
    """To rounding: springs are summed in vectors, whose order depends on how many there are."""
    modes = (ForceMode(0.05, 0.05, 0.05), ForceMode(0.05, 5.0, 0.2))
    model = TissueModel(replace(phantom), OUTER)
    points = np.r_[rest_state, np.zeros(6)] + np.random.default_rng(1).normal(0.0, 1e-2, (2, 5, 22))
    together = model.propagate_each(points, 1 / 120, modes)
    for k, mode in enumerate(modes):
        alone = model.propagate(points[k], 1 / 120, mode)
        np.testing.assert_allclose(together[k], alone, rtol=1e-11, atol=1e-14)
