"""The update in Joseph's form against the textbook."""

import numpy as np
import pytest

from estimators.consistency.joseph import joseph_update


def definite(n, rng):
    """A random positive definite (n, n) with eigenvalues of 0.1 and more."""
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (4, 0), (4, 1), (4, 4), (22, 6), (3, 5), (40, 30)])
def test_update_is_the_textbook_one(n, m):
    """K = P H' S⁻¹, x + K y, (1 - K H) P, y' S⁻¹ y, log det S. Rounding times a condition number of some hundreds."""
    rng = np.random.default_rng(10 * n + m)
    x, P, H, R, z = rng.normal(size=n), definite(n, rng), rng.normal(size=(m, n)), definite(m, rng), rng.normal(size=m)
    mean, cov, y, S, K, nis, log_det, ok = joseph_update(x, P, z, H, R)
    assert ok
    innovation, innovation_cov = z - H @ x, H @ P @ H.T + R
    gain = P @ H.T @ np.linalg.inv(innovation_cov)
    np.testing.assert_allclose(y, innovation, rtol=0, atol=1e-13)
    np.testing.assert_allclose(S, innovation_cov, rtol=1e-12, atol=1e-11)
    np.testing.assert_allclose(K, gain, rtol=0, atol=1e-10)
    np.testing.assert_allclose(mean, x + gain @ innovation, rtol=0, atol=1e-10)
    np.testing.assert_allclose(cov, (np.eye(n) - gain @ H) @ P, rtol=0, atol=1e-10 * P.max())
    np.testing.assert_array_equal(cov, cov.T)
    assert nis == pytest.approx(innovation @ np.linalg.solve(innovation_cov, innovation), rel=1e-10)
    assert log_det == pytest.approx(np.linalg.slogdet(innovation_cov)[1], rel=0, abs=1e-10)


def test_update_with_an_impossible_innovation_covariance_is_reported():
    *_, ok = joseph_update(np.zeros(2), np.eye(2), np.zeros(1), np.array([[1.0, 0.0]]), np.array([[-1.5]]))
    assert not ok


def test_josephs_form_stays_definite_where_the_short_form_does_not():
    """30 pairs of marks of 1e-5 against a prior of 1e2: a sum of two positive terms; (1 - K H) P is a difference."""
    for seed in range(60):
        rng, cov = np.random.default_rng(seed), 1e4 * np.eye(6)
        for _ in range(30):
            cov = joseph_update(np.zeros(6), cov, np.zeros(2), rng.normal(size=(2, 6)), 1e-10 * np.eye(2))[1]
            assert np.linalg.eigvalsh(cov)[0] > 0
