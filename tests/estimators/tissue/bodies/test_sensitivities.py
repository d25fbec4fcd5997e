"""What constants that are off make of the error: against motions and rest shapes of networks that have them so."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dynamics import (
    OUTER,
    MassSpringNetwork,
    equilibrium_with_fixed,
    independent_uncertainty,
    integrate_adaptive,
    pack,
    parameters,
    rest_shape,
    scale_parameters,
)
from estimators import FixBias, ForceMode, TissueModel

SMALL = 1e-3
"""Relative change of a constant: its second order is a thousandth of its first."""
MODE = ForceMode(white=0.0, poke=0.0, lasting_s=0.2)


@pytest.mark.parametrize("constants", [0, 2])
def test_columns_of_a_calibration_move_as_errors_do(phantom, rest_state, constants):
    """Under no force of their own: what is put beside a moving state stays the difference of two motions."""
    unsure = independent_uncertainty(parameters(phantom, ("stiffness",))[:2], 0.1) if constants else None
    model = TissueModel(phantom, OUTER, uncertainty=unsure, n_calibration=3)
    mean = np.r_[rest_state + np.random.default_rng(0).normal(0.0, 0.02, 16), np.zeros(6)]
    columns = np.random.default_rng(1).normal(0.0, 1e-3, (22, constants + 3))
    moved = model.propagate_columns(mean[None], columns[None], 1 / 120, (MODE,))[0]
    ends = model.propagate(np.vstack([mean, mean + columns.T]), 1 / 120, MODE)
    assert (model.n_columns, model.n_calibration) == (constants + 3, 3)
    assert TissueModel(phantom, OUTER, uncertainty=unsure).n_columns == constants
    shared = np.arange(1.0, 13.0).reshape(4, 3)
    np.testing.assert_array_equal(model.among_columns(shared), np.c_[np.zeros((4, constants)), shared])
    np.testing.assert_allclose(moved[:, constants:], (ends[1:] - ends[0]).T[:, constants:], rtol=0, atol=1e-14)
    assert np.abs(moved - columns)[:8, constants:].max() > 1e-6


@pytest.mark.parametrize("kind", ["stiffness", "rest_length", "damping", "drag", "friction"])
def test_columns_are_what_changed_constants_do_to_the_motion(phantom, kind):
    """0.1 s of a moving phantom by DOP853 with and without the change: within 8 % of the largest shift.

    Steps of 1/120 s take the mean of the change's force at both ends: second order. Without friction, whose bend over
    5 mm/s is sharper than that; its own column is held to 8 % in places, which it hardly moves in velocities.
    """
    if kind != "friction":
        phantom = replace(phantom, friction=np.zeros(7))
    rng = np.random.default_rng(0)
    x = phantom.positions[phantom.free] + rng.normal(0.0, 0.02, (4, 2))
    start = pack(x, rng.normal(0.0, 0.3, (4, 2)))
    which = parameters(phantom, (kind,))
    model = TissueModel(phantom, OUTER, uncertainty=independent_uncertainty(which, SMALL))
    mean, columns = np.r_[start, np.zeros(6)], np.zeros((1, 22, len(which)))
    for _ in range(12):
        columns = model.propagate_columns(mean[None], columns, 0.1 / 12, (MODE,))
        mean = model.propagate(mean[None], 0.1 / 12, MODE)[0]
    usual = integrate_adaptive(phantom, start, [0.0, 0.1])[-1]
    for k in range(len(which)):
        changed = (
            integrate_adaptive(scale_parameters(phantom, which[k : k + 1], [SMALL]), start, [0.0, 0.1])[-1] - usual
        )
        scale = np.abs(changed).max()
        rows = slice(0, 8 if kind == "friction" else 16)
        np.testing.assert_allclose(columns[0, rows, k] / scale, changed[rows] / scale, rtol=0, atol=0.08)
        assert np.abs(changed[:8]).max() > 1e-9


def test_columns_of_a_rest_shape_are_those_of_other_rest_shapes(phantom):
    """d(rest)/d(log constant) by central differences of `rest_shape`, free and with marked nodes held. 1e-5 of it."""
    which = parameters(phantom, ("stiffness", "rest_length"))
    model = TissueModel(phantom, OUTER, uncertainty=independent_uncertainty(which, 1.0))
    held = {node: phantom.positions[phantom.index(node)] for node in OUTER}
    free, kept = model.resting_columns(phantom.positions), model.resting_columns(phantom.positions, [0, 1, 4, 5, 6, 7])
    for k in range(len(which)):
        ends = [scale_parameters(phantom, which[k : k + 1], [sign * SMALL]) for sign in (1.0, -1.0)]
        for found, shapes in (
            (free, [rest_shape(end) for end in ends]),
            (kept, [equilibrium_with_fixed(end, held) for end in ends]),
        ):
            moved = (shapes[0] - shapes[1])[phantom.free].ravel() / (2.0 * SMALL)
            np.testing.assert_allclose(found[:8, k], moved, rtol=0, atol=1e-5 * max(np.abs(moved).max(), 1e-3))
    assert np.abs(kept[[0, 1, 4, 5, 6, 7]]).max() == 0.0
    assert np.abs(free[8:]).max() == 0.0


def test_a_body_without_anchors_rests_in_the_shape_of_its_lengths_where_it_was():
    """A triangle of springs is rigid: each length alone changes by its error, and nothing is moved or turned. Rounding.

    A spring as long as it rests makes no difference by its stiffness.
    """
    corners, springs = np.array([[0.0, 0.0], [0.03, 0.0], [0.0, 0.04]]), np.array([[0, 1], [1, 2], [2, 0]])
    lengths = np.array([0.03, 0.05, 0.04])
    triangle = MassSpringNetwork(
        names=("a", "b", "c"),
        positions=corners,
        masses=np.full(3, 0.02),
        fixed=np.zeros(3, dtype=bool),
        drag=np.zeros(3),
        friction=np.zeros(3),
        springs=springs,
        stiffness=np.array([50.0, 20.0, 90.0]),
        rest_lengths=lengths,
        damping=np.zeros(3),
        gravity=np.zeros(2),
    )
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


def test_the_bias_of_fixes_fades_slowly_and_moves_nothing(phantom, rest_state):
    """exp(-dt / tau) of the mean; variance (1 - exp(-2 dt / tau)) sd², so that sd² is kept. Rounding."""
    plain, model = TissueModel(phantom, OUTER), TissueModel(phantom, OUTER, bias=FixBias(2e-3, lasting_s=10.0))
    assert (plain.dim_x, model.dim_x) == (22, 24)
    mode = ForceMode(0.05, 5.0, 0.2)
    point = np.r_[rest_state, np.full(6, 0.3), 1e-3, -2e-3]
    moved = model.propagate(point[None], 0.5, mode)[0]
    np.testing.assert_allclose(moved[22:], np.exp(-0.05) * point[22:], rtol=1e-12)
    np.testing.assert_allclose(moved[:22], plain.propagate(point[None, :22], 0.5, mode)[0], rtol=0, atol=1e-14)
    Q = model.noise(0.5, mode)
    np.testing.assert_allclose(np.exp(-0.1) * 4e-6 * np.eye(2) + Q[22:, 22:], 4e-6 * np.eye(2), rtol=0, atol=1e-18)
    assert np.abs(Q[:22, 22:]).max() == 0.0
    np.testing.assert_array_equal(Q[:22, :22], plain.noise(0.5, mode))
    A, density = model.linearised(phantom.positions, mode)
    np.testing.assert_allclose(np.diag(A)[22:], -0.1)
    np.testing.assert_allclose(np.diag(density)[22:], 2.0 * 4e-6 / 10.0)
    for found, own in zip((A, density), plain.linearised(phantom.positions, mode), strict=True):
        np.testing.assert_array_equal(found[:22, :22], own)


def test_a_set_of_points_with_a_spring_turned_is_found(phantom, rest_state):
    """M2 put on the far side of M1 turns their spring; the set beside it, spread by 1 mm, has none turned."""
    model = TissueModel(phantom, OUTER)
    points = np.tile(np.r_[rest_state, np.zeros(6)], (2, 3, 1))
    points[:, 1] += 1e-3
    points[1, 2, 2] = rest_state[0] - 0.1
    assert model.turned(points).tolist() == [False, True]


def test_modes_move_together_as_they_do_alone(phantom, rest_state):
    """To rounding: springs are summed in vectors, whose order depends on how many there are."""
    modes = (ForceMode(0.05, 0.05, 0.05), ForceMode(0.05, 5.0, 0.2))
    model = TissueModel(replace(phantom), OUTER)
    points = np.r_[rest_state, np.zeros(6)] + np.random.default_rng(1).normal(0.0, 1e-2, (2, 5, 22))
    together = model.propagate_each(points, 1 / 120, modes)
    for k, mode in enumerate(modes):
        alone = model.propagate(points[k], 1 / 120, mode)
        np.testing.assert_allclose(together[k], alone, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("kind", ["stiffness", "rest_length", "damping", "drag"])
def test_columns_of_constants_converge_in_second_order(phantom, kind):
    """Over 0.1 s in n, 2n, 4n steps: log2 of |c(n) - c(2n)| / |c(2n) - c(4n)| is 2 within 0.1 from 24 steps on.

    The trapezium of a constant's force at both ends of a step; held from its start it would be of first order. Changes
    of 1e-6, so that nothing but the step matters, and no friction, whose bend is sharper than a step.
    """
    phantom = replace(phantom, friction=np.zeros(7))
    rng = np.random.default_rng(0)
    start = pack(phantom.positions[phantom.free] + rng.normal(0.0, 0.02, (4, 2)), rng.normal(0.0, 0.3, (4, 2)))
    which = parameters(phantom, (kind,))
    model = TissueModel(phantom, OUTER, uncertainty=independent_uncertainty(which, 1e-6))
    found = []
    for n in (24, 48, 96, 192):
        mean, columns = np.r_[start, np.zeros(6)], np.zeros((1, 22, len(which)))
        for _ in range(n):
            columns = model.propagate_columns(mean[None], columns, 0.1 / n, (MODE,))
            mean = model.propagate(mean[None], 0.1 / n, MODE)[0]
        found.append(columns[0, :16])
    steps = [np.linalg.norm(b - a) for a, b in pairwise(found)]
    orders = np.log2([a / b for a, b in pairwise(steps)])
    np.testing.assert_allclose(orders, 2.0, rtol=0, atol=0.1)
