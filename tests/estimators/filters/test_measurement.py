"""Errors that measurements have in common, and outliers: conditioning of normal distributions, SciPy's densities."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators import InteractingMixture, UnscentedKalmanFilter
from estimators.filters.kernels import with_outliers
from estimators.filters.measurement import REMEMBERED_S, CommonErrors, Outliers

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


X, P = np.zeros(4), np.diag([4.0, 1.0, 2.0, 0.5]) + 0.1
H, R = np.eye(4), 0.1 * np.eye(4) + 0.01
NONE = np.zeros((4, 0))
ODDS, VARIANCE = np.log(1e-3), 900.0


def by_density(y: np.ndarray, columns: np.ndarray) -> list[bool]:
    """Which of both halves are likelier by odds of 1e-3 and a standard deviation of 30 more."""
    S = P + R + columns @ columns.T
    outlying = []
    for own in (slice(0, 2), slice(2, 4)):
        as_said = multivariate_normal(np.zeros(2), S[own, own]).logpdf(y[own])
        besides = multivariate_normal(np.zeros(2), S[own, own] + VARIANCE * np.eye(2)).logpdf(y[own])
        outlying.append(bool(ODDS + besides > as_said))
    return outlying


@pytest.mark.parametrize("columns", [NONE, np.array([[3.0], [-1.0], [0.0], [2.0]])], ids=["alone", "with columns"])
def test_what_is_likelier_so_is_an_outlier(columns):
    """300 draws, half of them far off in a part: as densities have it; R and its logarithms, to rounding."""
    rng, counts = np.random.default_rng(0), np.zeros(3, dtype=int)
    for k in range(300):
        z = rng.multivariate_normal(np.zeros(4), P + R) * (1.0 + 6.0 * (k % 2))
        outlying = by_density(z, columns)
        widened, log_odds, grown = with_outliers(X, P, z, H, R, columns, 2, VARIANCE, ODDS)
        np.testing.assert_allclose(widened, R + VARIANCE * np.diag(np.repeat(outlying, 2)), rtol=1e-14)
        assert log_odds == pytest.approx(sum(outlying) * ODDS)
        S = P + R + columns @ columns.T
        parts = [S[a : a + 2, a : a + 2] for a, one in zip((0, 2), outlying, strict=True) if one]
        logs = [np.linalg.slogdet(part + VARIANCE * np.eye(2))[1] - np.linalg.slogdet(part)[1] for part in parts]
        assert grown == pytest.approx(sum(logs), abs=1e-9)
        counts[sum(outlying)] += 1
    assert (counts > 5).all()


def test_a_mode_is_as_likely_as_its_outliers_are():
    """One mode is right, one is 100 beside: an outlier to it, so that its odds fall by 1e-3 and a density, no further.

    Its state is that of the textbook's update with the wider R, its distance by how much that is less than its peak.
    """
    filters = []
    for mean in (0.0, 100.0):
        f = UnscentedKalmanFilter(1, lambda points, _dt: points)
        f.x, f.P, f.Q = np.array([mean]), np.eye(1), np.zeros((1, 1))
        filters.append(f)
    mixture = InteractingMixture(filters, np.array([0.2, 0.8]), np.zeros((2, 2)))
    z, noise = np.array([0.5]), 0.25 * np.eye(1)
    mixture.update_linear(z, np.eye(1), noise, outliers=Outliers(1, VARIANCE, ODDS))
    right = multivariate_normal(0.0, 1.25).pdf(0.5)
    wrong = 1e-3 * multivariate_normal(100.0, 1.25 + VARIANCE).pdf(0.5)
    expected = np.array([0.2 * right, 0.8 * wrong])
    np.testing.assert_allclose(mixture.mu, expected / expected.sum(), rtol=1e-9)
    assert mixture.log_likelihood == pytest.approx(np.log(expected.sum()), rel=1e-12)
    gain = 1.0 / (1.25 + VARIANCE)
    np.testing.assert_allclose(mixture.filters[1].x, 100.0 + gain * (0.5 - 100.0), rtol=1e-12)
    np.testing.assert_allclose(mixture.filters[1].P, 1.0 - gain, rtol=1e-9)
    peak = multivariate_normal(0.0, 1.25).logpdf(0.0)
    assert mixture.filters[1].nis == pytest.approx(2.0 * (peak - np.log(wrong)), rel=1e-12)
    assert mixture.filters[0].nis == pytest.approx(0.25 / 1.25, rel=1e-12)
