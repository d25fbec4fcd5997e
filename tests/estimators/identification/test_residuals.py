"""The test of residuals and standard errors that allow for them, against series of known correlation."""

from dataclasses import replace

import numpy as np
import pytest

from estimators.identification.filter_pass import Pass
from estimators.identification.residuals import long_run_covariance, residual_covariance, within_prior
from tests.estimators.identification.passes import pass_of

N = 2000


def made_pass(scores, nis):
    """Three directions whose scores have unit variance where the model is right; two innovations a frame."""
    n = scores.shape[1]
    return Pass(scores, len(scores) * np.eye(n), 0.0, nis, np.full(len(scores), 2.0), np.zeros((n, n)))


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


def test_white_scores_leave_the_covariance_nearly_as_it_is():
    """The largest of three sampled eigenvalues of 1, by some 70 independent numbers, is below 1.7."""
    rng = np.random.default_rng(1)
    cov, test = residual_covariance(made_pass(rng.normal(size=(N, 3)), rng.chisquare(2.0, N)))
    assert 1.0 / (N + 1.0) <= cov[0, 0] < 1.7 / N
    assert test.explained
    assert test.inflation < np.sqrt(1.7)
    assert test.n == 2 * N


def test_correlated_scores_count_for_fewer():
    """Correlation 0.9 in the first of three: 19 times the variance, within 50 %, of all: the largest ratio counts."""
    rng = np.random.default_rng(2)
    scores = rng.normal(size=(N, 3))
    scores[:, 0] = autoregressive(rng, 0.9, N, 1)[:, 0]
    cov, test = residual_covariance(made_pass(scores, rng.chisquare(2.0, N)))
    np.testing.assert_allclose(np.diag(cov) * N, 19.0, rtol=0.5)
    assert test.inflation == pytest.approx(np.sqrt(19.0), rel=0.25)
    assert test.n_effective == pytest.approx(2 * N / 19.0, rel=0.5)


def test_large_residuals_are_not_explained():
    rng = np.random.default_rng(3)
    _, test = residual_covariance(made_pass(2.0 * rng.normal(size=(N, 3)), 4.0 * rng.chisquare(2.0, N)))
    assert test.size == pytest.approx(4.0, rel=0.1)
    assert not test.explained


def test_many_outliers_are_not_explained():
    """Of 2,000 marks, up to one in a hundred may be an outlier; without any inlier, none."""
    rng = np.random.default_rng(1)
    white = replace(made_pass(rng.normal(size=(N, 3)), rng.chisquare(2.0, N)), n_hidden=N)
    assert residual_covariance(replace(white, n_outliers=20.0))[1].explained
    assert not residual_covariance(replace(white, n_outliers=21.0))[1].explained
    assert not residual_covariance(replace(white, dof=np.zeros(N), n_outliers=1.0))[1].explained


def test_what_frames_repeat_is_counted_about_once():
    """Five frames that say the same: the posterior is that of one each, and not five times as sure.

    The lags, 31 of 1,000 frames, hold four fifths to all of a repetition; the variance of 31 lags scatters by a fifth.
    """
    cov, test = residual_covariance(pass_of(np.repeat(np.random.default_rng(5).normal(size=200), 5)))
    assert cov[0, 0] == pytest.approx(1.0 / 201.0, rel=0.4)
    assert test.n == 1000
    assert test.n_effective == pytest.approx(200.0, rel=0.4)


@pytest.mark.parametrize("size", [1e2, 1e9, 1e18])
def test_nothing_leaves_more_of_a_constant_than_no_data(size):
    """Without data a constant of unit prior is off from 2 by a mean square of 1 + 2^2, from 0 by 1."""
    cov, n_limited = within_prior(size * np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([2.0, 0.0]))
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
    reported = axes * [0.01, 1.0] @ axes.T
    same, n_none = within_prior(reported, np.array([0.3, 4.0]))
    assert same is reported
    assert n_none == 0
