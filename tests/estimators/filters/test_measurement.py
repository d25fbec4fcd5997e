"""What innovations tell of errors that measurements have in common: conditioning of normal distributions."""

import numpy as np
import pytest

from estimators.filters.measurement import REMEMBERED_S, CommonErrors

SHARED = np.array([[0.4, 0.0, -0.2], [0.1, 0.0, 0.5]])
"""Of the three errors the second moves no measurement."""
MOVING = [True, False, True]


def known() -> CommonErrors:
    return CommonErrors.unknown(3).moved_by(SHARED)


def test_errors_that_move_a_measurement_are_of_unit_variance_and_the_others_known():
    nothing = CommonErrors.unknown(3)
    assert not nothing.moving.any()
    assert nothing.root.shape == (3, 0)
    np.testing.assert_array_equal(known().moving, MOVING)
    np.testing.assert_array_equal(known().cov, np.diag(MOVING).astype(float))
    np.testing.assert_array_equal(known().mean, np.zeros(3))


def test_what_was_told_stays_when_another_error_moves_a_measurement():
    told = known().told([np.ones(2)], [np.eye(2)], SHARED[None], np.ones(1))
    also = told.moved_by(np.array([[0.0, 0.3, 0.0]]))
    assert also.moving.all()
    np.testing.assert_array_equal(also.mean, told.mean)
    np.testing.assert_array_equal(also.cov, told.cov + np.diag([0.0, 1.0, 0.0]))
    assert told.moved_by(SHARED) is told
    np.testing.assert_array_equal(told.moved_by(np.zeros((2, 2))).moving, [False, False])


def test_an_innovation_tells_of_them_by_bayes_rule():
    """Precisions add: cov' = (cov^-1 + C' S^-1 C)^-1, mean' = cov' (cov^-1 mean + C' S^-1 y); twice. 1e-12."""
    C, S, found = SHARED[:, MOVING], np.array([[0.5, 0.1], [0.1, 0.3]]), known()
    precision, weighed = np.eye(2), np.zeros(2)
    for y in (np.array([0.7, -0.2]), np.array([0.1, 0.9])):
        found = found.told([y], [S], SHARED[None], np.ones(1))
        precision = precision + C.T @ np.linalg.solve(S, C)
        weighed = weighed + C.T @ np.linalg.solve(S, y)
        cov = np.linalg.inv(precision)
        np.testing.assert_allclose(found.cov[np.ix_(MOVING, MOVING)], cov, rtol=1e-12)
        np.testing.assert_allclose(found.mean[MOVING], cov @ weighed, rtol=1e-12)
        np.testing.assert_allclose(found.root @ found.root.T, found.cov, atol=1e-14)
        assert found.mean[1] == 0.0


def test_of_several_modes_the_mixture_tells():
    """Mean and covariance of their innovations together, between them included."""
    ys, covs, mu = [np.array([0.7, -0.2]), np.array([-0.3, 0.4])], [np.eye(2), 2.0 * np.eye(2)], np.array([0.3, 0.7])
    columns = np.array([SHARED, 2.0 * SHARED])
    draws = [(mu[0], ys[0], covs[0]), (mu[1], ys[1], covs[1])]
    mean = sum(w * y for w, y, _ in draws)
    second = sum(w * (cov + np.outer(y, y)) for w, y, cov in draws)
    one = known().told([mean], [second - np.outer(mean, mean)], 1.7 * SHARED[None], np.ones(1))
    both = known().told(ys, covs, columns, mu)
    np.testing.assert_allclose(both.mean, one.mean, rtol=1e-12)
    np.testing.assert_allclose(both.cov, one.cov, rtol=1e-12)


def test_it_is_forgotten_in_time_however_that_is_cut():
    told = known().told([np.ones(2)], [0.01 * np.eye(2)], SHARED[None], np.ones(1))
    once, twice = told.later(2.0), told.later(0.5).later(1.5)
    np.testing.assert_allclose(twice.mean, once.mean, rtol=1e-12)
    np.testing.assert_allclose(twice.cov, once.cov, rtol=1e-12, atol=1e-15)
    assert once.mean[0] == pytest.approx(np.exp(-2.0 / REMEMBERED_S) * told.mean[0])
    np.testing.assert_allclose(told.later(1e3).cov, known().cov, atol=1e-12)
    np.testing.assert_allclose(told.later(1e3).mean, 0.0, atol=1e-12)
