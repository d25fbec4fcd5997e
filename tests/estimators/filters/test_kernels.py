"""The compiled sums against NumPy, SciPy and filterpy."""

import filterpy.kalman
import numpy as np
import pytest

from estimators.filters.kernels import (
    block_contributions,
    chol_lower,
    moments,
    squared_mahalanobis,
    symmetric_points,
)


def definite(n, rng):
    """A random positive definite (n, n) with eigenvalues of 0.1 and more."""
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("n", [1, 2, 6, 22])
def test_factor_is_numpys(n):
    """Lower L with L L' = P, unique for positive diagonal. Rounding times a condition number of 1e4 at most."""
    P = definite(n, np.random.default_rng(n))
    L, ok = chol_lower(P)
    assert ok
    np.testing.assert_allclose(L, np.linalg.cholesky(P), rtol=0, atol=1e-12 * P.max())
    np.testing.assert_array_equal(np.triu(L, 1), np.zeros((n, n)))


@pytest.mark.parametrize(
    "P", [-np.eye(1), np.zeros((2, 2)), np.array([[1.0, 2.0], [2.0, 1.0]]), np.diag([1.0, np.nan])]
)
def test_a_matrix_that_is_not_positive_definite_is_reported(P):
    _, ok = chol_lower(P)
    assert not ok
    _, ok = symmetric_points(np.zeros(len(P)), P, 1.0)
    assert not ok


@pytest.mark.parametrize(("alpha", "kappa"), [(1.0, 0.0), (0.5, 1.0), (1.0, -3.0)])
def test_sigma_points_are_filterpys(alpha, kappa):
    """Merwe's points x, x + columns, x - columns of chol(alpha² (n + kappa) P) in that order. Rounding."""
    n, rng = 6, np.random.default_rng(0)
    x, P = rng.normal(size=n), definite(n, rng)
    expected = filterpy.kalman.MerweScaledSigmaPoints(n, alpha, 2.0, kappa).sigma_points(x, P)
    points, ok = symmetric_points(x, P, alpha**2 * (n + kappa))
    assert ok
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 22])
def test_moments_are_the_weighted_sums(n):
    """Equations x = sum W X and P = sum Wc (X - x)(X - x)' + Q, Q taken symmetric. Rounding of sums of 2n + 1 terms."""
    rng = np.random.default_rng(n)
    points, Wm, Wc = rng.normal(size=(2 * n + 1, n)), rng.normal(size=2 * n + 1), rng.normal(size=2 * n + 1)
    Wm /= Wm.sum()
    Q = rng.normal(size=(n, n))
    x, P = moments(points, Wm, Wc, Q)
    mean = Wm @ points
    expected = (points - mean).T @ np.diag(Wc) @ (points - mean) + (Q + Q.T) / 2
    np.testing.assert_allclose(x, mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(P, expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_array_equal(P, P.T)


@pytest.mark.parametrize("m", [2, 6])
def test_an_innovation_is_judged_as_numpy_does(m):
    """Distance, and what each mark of two coordinates contributes. Rounding."""
    rng = np.random.default_rng(m)
    y, S, gain = rng.normal(size=m), definite(m, rng), rng.normal(size=(2, m))
    S_inv = np.linalg.inv(S)
    assert squared_mahalanobis(y, S) == pytest.approx(y @ S_inv @ y, rel=1e-10)
    expected = [
        np.trace(gain[:, k : k + 2] @ np.linalg.inv(S_inv[k : k + 2, k : k + 2]) @ gain[:, k : k + 2].T)
        for k in range(0, m, 2)
    ]
    np.testing.assert_allclose(block_contributions(gain, S_inv, 2), expected, rtol=1e-10)
