"""Sigma points against filterpy, the compiled judgement of an innovation against NumPy."""

import filterpy.kalman
import numpy as np
import pytest

from estimators.filters.kernels import block_contributions, squared_mahalanobis, symmetric_points


def definite(n, rng):
    """A random positive definite (n, n) with eigenvalues of 0.1 and more."""
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


@pytest.mark.parametrize(("alpha", "kappa"), [(1.0, 0.0), (0.5, 1.0), (1.0, -3.0)])
def test_sigma_points_are_filterpys(alpha, kappa):
    """Merwe's points x, x + columns, x - columns of chol(alpha² (n + kappa) P) in that order. Rounding."""
    n, rng = 6, np.random.default_rng(0)
    x, P = rng.normal(size=n), definite(n, rng)
    expected = filterpy.kalman.MerweScaledSigmaPoints(n, alpha, 2.0, kappa).sigma_points(x, P)
    points, ok = symmetric_points(x, P, alpha**2 * (n + kappa))
    assert ok
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-13)


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
