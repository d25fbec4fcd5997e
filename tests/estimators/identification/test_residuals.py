"""The test of residuals and standard errors that allow for them, against series of known correlation."""

import numpy as np
import pytest

from estimators.identification.filter_pass import Pass
from estimators.identification.residuals import long_run_covariance, residual_covariance, within_prior

N = 2000


def made_pass(scores, nis):
    """Three directions whose scores have unit variance where the model is right; two innovations a frame."""
    n = scores.shape[1]
    return Pass(scores, len(scores) * np.eye(n), 0.0, nis, np.full(len(scores), 2.0))


def autoregressive(rng, phi, n, m):
    series = np.empty((n, m))
    series[0] = rng.normal(size=m)
    for k in range(1, n):
        series[k] = phi * series[k - 1] + np.sqrt(1.0 - phi**2) * rng.normal(size=m)
    return series


def test_long_run_variance_of_a_first_order_series():
    """Of unit variance and correlation phi it is (1 + phi) / (1 - phi), 19 at 0.9, to 20 %.

    With 100 lags the weights miss 2 phi / ((1 - phi)^2 101) / 19 = 9 %, and 40,000 steps scatter by 7 %.
    """
    series = autoregressive(np.random.default_rng(0), 0.9, 40_000, 1)
    assert long_run_covariance(series, 100)[0, 0] / 40_000 == pytest.approx(19.0, rel=0.2)


def test_white_residuals_of_the_right_size_leave_the_covariance_as_it_is():
    rng = np.random.default_rng(1)
    found = made_pass(rng.normal(size=(N, 3)), rng.chisquare(2.0, N))
    cov, test = residual_covariance(found, np.eye(3))
    np.testing.assert_allclose(cov, np.eye(3) / (N + 1.0), rtol=1e-12, atol=1e-18)
    assert test.explained
    assert test.inflation == 1.0
    assert test.n_effective == test.n == 2 * N


def test_correlated_scores_inflate_the_directions_that_they_are_in():
    """Correlation 0.9 in the first of three: its variance 19 times, within 50 %, the others' as they were."""
    rng = np.random.default_rng(2)
    scores = rng.normal(size=(N, 3))
    scores[:, 0] = autoregressive(rng, 0.9, N, 1)[:, 0]
    cov, test = residual_covariance(made_pass(scores, rng.chisquare(2.0, N)), np.eye(3))
    np.testing.assert_allclose(np.diag(cov) * N, [19.0, 1.0, 1.0], rtol=0.5)
    assert not test.explained
    assert test.inflation == pytest.approx(np.sqrt(19.0), rel=0.25)
    assert test.n_effective == pytest.approx(2 * N / 19.0, rel=0.5)


def test_large_residuals_inflate_all_directions():
    """Innovations of twice the standard deviation: four times the variance of every constant."""
    rng = np.random.default_rng(3)
    cov, test = residual_covariance(made_pass(2.0 * rng.normal(size=(N, 3)), 4.0 * rng.chisquare(2.0, N)), np.eye(3))
    np.testing.assert_allclose(np.diag(cov) * N, 4.0, rtol=0.1)
    assert test.size == pytest.approx(4.0, rel=0.1)
    assert not test.explained


def test_a_constant_that_no_residual_shows_keeps_its_prior():
    """Large, correlated residuals elsewhere: variance 1 where there is no information."""
    rng = np.random.default_rng(4)
    scores = 3.0 * autoregressive(rng, 0.9, N, 2)
    scores[:, 1] = 0.0
    found = Pass(scores, np.diag([float(N), 0.0]), 0.0, 9.0 * rng.chisquare(2.0, N), np.full(N, 2.0))
    cov, _ = residual_covariance(found, np.eye(2))
    assert cov[1, 1] == pytest.approx(1.0, rel=1e-9)
    assert cov[0, 0] * N > 50.0


def test_the_information_of_the_likelihood_takes_the_place_of_that_of_the_scores():
    """Explained: its own inverse. With correlated scores: the sandwich of what these have beyond their information."""
    rng = np.random.default_rng(4)
    own = np.diag([0.2 * N, N, 2.0 * N])
    scores, nis = rng.normal(size=(N, 3)), rng.chisquare(2.0, N)
    cov, test = residual_covariance(made_pass(scores, nis), np.eye(3), own)
    np.testing.assert_allclose(cov, np.linalg.inv(own + np.eye(3)), rtol=1e-12, atol=1e-18)
    assert test.explained
    scores[:, 0] = autoregressive(rng, 0.9, N, 1)[:, 0]
    cov, _ = residual_covariance(made_pass(scores, nis), np.eye(3), own)
    np.testing.assert_allclose(np.diag(cov) * N, [(0.2 + 18.0) / 0.2**2, 1.0, 0.5], rtol=0.5)


@pytest.mark.parametrize("size", [1e2, 1e9, 1e18])
def test_no_residuals_leave_more_of_a_constant_than_no_data(size):
    """Innovations so many times too large, correlated, about as informative as the prior: the sandwich has no limit.

    Without data a constant of unit prior is off from a guess at 2 by a mean square of 1 + 2^2, from one at 0 by 1.
    """
    rng = np.random.default_rng(5)
    scores = size * autoregressive(rng, 0.9, N, 2) / np.sqrt(N)
    found = Pass(scores, np.eye(2), 0.0, size**2 * rng.chisquare(2.0, N), np.full(N, 2.0))
    sandwich, _ = residual_covariance(found, np.eye(2))
    assert np.diag(sandwich).min() > size**2
    cov, n_limited = within_prior(sandwich, np.array([2.0, 0.0]))
    np.testing.assert_allclose(cov, np.diag([5.0, 1.0]), rtol=1e-9, atol=1e-9)
    assert n_limited == 2


def test_a_constant_that_diverging_residuals_swamp_has_a_positive_variance():
    """Of 1e36 and of 1e-4 beside it, rounding leaves no digit of the second: it is as uncertain as without data."""
    cov, n_limited = within_prior(np.array([[1e36, -3e17], [-3e17, 1e-4]]), np.zeros(2))
    np.testing.assert_allclose(cov, np.eye(2), rtol=1e-9, atol=1e-9)
    assert n_limited == 2


def test_only_directions_beyond_the_prior_are_limited():
    """Variances 0.01 and 50 of orthogonal sums, at 0: the first stays, the second is 1. Within the prior: as it was."""
    axes = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2.0)
    cov, n_limited = within_prior(axes * [0.01, 50.0] @ axes.T, np.zeros(2))
    np.testing.assert_allclose(cov, axes * [0.01, 1.0] @ axes.T, rtol=1e-12)
    assert n_limited == 1
    told = axes * [0.01, 1.0] @ axes.T
    same, n_none = within_prior(told, np.array([0.3, 4.0]))
    assert same is told
    assert n_none == 0
