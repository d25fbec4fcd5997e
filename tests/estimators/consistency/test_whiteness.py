"""White series pass, correlated ones do not, and correlations are those of known processes."""

import numpy as np
import pytest

from estimators import autocorrelation, portmanteau
from estimators.consistency import effective_count


def autoregressive(phi, n, rng):
    """x_k = phi x_(k-1) + w_k, (n,), from its stationary distribution."""
    x = np.empty(n)
    x[0] = rng.normal() / np.sqrt(1.0 - phi**2)
    for k in range(1, n):
        x[k] = phi * x[k - 1] + rng.normal()
    return x


def test_correlations_of_an_autoregressive_series_are_its_powers():
    """phi^lag; 20,000 steps leave some 3 / sqrt(20,000) (1 + phi²) / (1 - phi²) of scatter."""
    found = autocorrelation(autoregressive(0.6, 20_000, np.random.default_rng(0)), 4)
    np.testing.assert_allclose(found[:, 0, 0], 0.6 ** np.arange(1, 5), rtol=0, atol=0.045)


def test_lags_have_a_direction():
    """The second coordinate follows the first a step later: entry (1, 0) of the first lag is 1, its mirror 0."""
    first = np.random.default_rng(1).normal(size=5001)
    found = autocorrelation(np.column_stack([first[1:], first[:-1]]), 1)[0]
    assert found[1, 0] == pytest.approx(1.0, abs=0.05)
    assert found[0, 1] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("m", [1, 3])
def test_a_white_series_is_refused_as_often_as_is_said(m):
    """P below 5 % in 5 % of 400 series: between 5 and 37 of them, 99.9 % binomial."""
    mixing = np.array([[1.0, 0.0, 0.0], [0.7, 1.0, 0.0], [-3.0, 0.2, 0.5]])[:m, :m]
    low = sum(portmanteau(np.random.default_rng(k).normal(size=(200, m)) @ mixing.T, 5) < 0.05 for k in range(400))
    assert 5 <= low <= 37


def test_a_correlated_series_is_refused():
    rng = np.random.default_rng(3)
    assert portmanteau(autoregressive(0.3, 500, rng), 5) < 1e-4
    hidden = np.column_stack([autoregressive(0.3, 500, rng), rng.normal(size=500)])
    assert portmanteau(hidden, 5) < 1e-3


def test_the_test_does_not_depend_on_scales_and_turns():
    series = np.random.default_rng(4).normal(size=(300, 2))
    turned = series @ np.array([[2.0, 1.0], [0.0, 1e-3]])
    assert portmanteau(turned, 6) == pytest.approx(portmanteau(series, 6), rel=1e-6)


def test_a_bias_is_no_whiteness():
    assert portmanteau(np.random.default_rng(5).normal(size=500) + 0.5, 5) < 1e-6


@pytest.mark.parametrize("n_lags", [0, 10, 11])
def test_lags_that_the_series_does_not_have_are_refused(n_lags):
    with pytest.raises(ValueError, match="n_lags: expected 1 to 9"):
        autocorrelation(np.ones(10), n_lags)


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_correlated_values_are_worth_fewer(phi):
    """For a first-order autoregression (1 - phi) / (1 + phi) of them [geyer1992]; 200 series of 2000.

    To 10 %: it stops where noise has made a sum negative, and so adds up more of what was positive.
    """
    rng, n = np.random.default_rng(8), 2000
    noise = rng.normal(size=(n + 200, 200))
    series = np.zeros_like(noise)
    for k in range(1, len(noise)):
        series[k] = phi * series[k - 1] + noise[k]
    counts = [effective_count(one) for one in series[200:].T]
    assert n / np.mean(n / np.array(counts)) == pytest.approx(n * (1.0 - phi) / (1.0 + phi), rel=0.1)


def test_values_that_do_not_vary_are_worth_one():
    assert effective_count(np.full(50, 3.0)) == 1.0
    assert effective_count([2.0]) == 1.0
