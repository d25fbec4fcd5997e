"""The compiled step of the smoother against the same equations by NumPy, in the coordinates of the state."""

import numpy as np
import pytest

from estimators.filters.kernels import gains, met, roots_each

N_MODES, DIM = 3, 5


def definite(rng, n=N_MODES):
    """Covariances (n, DIM, DIM) with standard deviations from 0.01 to 1."""
    A = rng.normal(size=(n, DIM, DIM)) * np.geomspace(0.01, 1.0, DIM)[:, None]
    return A @ A.mT + 1e-6 * np.eye(DIM)


def test_met_is_the_product_of_two_gaussians_and_its_integral():
    """N(x; m, P) exp(y'n - y'Ny/2), y = L^-1 (x - c): its covariance, mean and integral in information form. 1e-9."""
    rng = np.random.default_rng(1)
    means, covs, mixes = rng.normal(size=(N_MODES, DIM)), definite(rng), definite(rng)
    centres, pull = rng.normal(size=(2, N_MODES, DIM))
    N, L = definite(rng), np.linalg.cholesky(mixes)
    logs, found, spread, fine = met(means, np.linalg.cholesky(covs), centres, L, N, pull)
    assert fine
    for i in range(N_MODES):
        for j in range(N_MODES):
            inverse = np.linalg.inv(L[j])
            W, n = inverse.T @ N[j] @ inverse, inverse.T @ pull[j]
            own = np.linalg.inv(covs[i])
            P = np.linalg.inv(own + W)
            x = P @ (own @ means[i] + n + W @ centres[j])
            assert spread[i, j] == pytest.approx(P, rel=1e-9, abs=1e-12)
            assert found[i, j] == pytest.approx(x, rel=1e-9, abs=1e-9)
            at = 0.5 * (x @ np.linalg.inv(P) @ x - means[i] @ own @ means[i] - centres[j] @ W @ centres[j])
            integral = at - n @ centres[j] + 0.5 * np.linalg.slogdet(P @ own)[1]
            assert logs[i, j] == pytest.approx(integral, rel=1e-9, abs=1e-9)


def test_gains_are_those_of_rauch_tung_and_striebel():
    """L G' with G = (F L)' P^-1 is C F' P^-1, C the mix's covariance [rauch1965]. 1e-9."""
    rng = np.random.default_rng(2)
    mixes, predicted, after = definite(rng), definite(rng), definite(rng)
    F = rng.normal(size=(N_MODES, DIM, DIM))
    G, M, fine = gains(np.linalg.cholesky(mixes), predicted, F, after)
    assert fine
    for j in range(N_MODES):
        expected = mixes[j] @ F[j].T @ np.linalg.inv(predicted[j])
        L = np.linalg.cholesky(mixes[j])
        assert L @ G[j] == pytest.approx(expected, rel=1e-9, abs=1e-9)
        taken = expected @ (predicted[j] - after[j]) @ expected.T
        assert L @ M[j] @ L.T == pytest.approx(taken, rel=1e-9, abs=1e-9)


def test_what_is_not_definite_is_said():
    rng = np.random.default_rng(3)
    covs = definite(rng)
    roots, fine = roots_each(covs)
    assert fine
    assert roots == pytest.approx(np.linalg.cholesky(covs), rel=1e-12)
    covs[1] = -covs[1]
    assert not roots_each(covs)[1]
    assert not gains(roots, covs, definite(rng), definite(rng))[2]
    nothing = np.zeros((N_MODES, DIM))
    assert not met(nothing, roots, nothing, roots, 1e9 * covs, nothing)[3]
