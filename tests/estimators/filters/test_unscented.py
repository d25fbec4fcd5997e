"""The unscented filter against filterpy's and the textbook Kalman filter."""

import filterpy.kalman
import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import OUTER, Stepper, plain_step, state_matrix
from estimators import CovarianceError, UnscentedKalmanFilter, positive_points


def started(f, x, P, Q):
    f.x, f.P, f.Q = x.copy(), P.copy(), Q.copy()
    return f


def bearing(states):
    """Squared distance of two masses from the floor's middle and their product: nonlinear, (n_points, 3)."""
    s = np.atleast_2d(states)
    return np.column_stack([s[:, 0] ** 2 + s[:, 1] ** 2, s[:, 4] ** 2 + s[:, 5] ** 2, s[:, 0] * s[:, 5]])


def outer_marks(states):
    """Positions of the outer masses M1, M3, M4, (n_points, 6)."""
    return np.atleast_2d(states)[:, [0, 1, 4, 5, 6, 7]]


@pytest.mark.parametrize(
    ("hx", "m", "sd", "alpha", "beta", "kappa"),
    [(outer_marks, 6, 4e-3, 0.5, 2.0, 1.0), (bearing, 3, 1e-3, 1.0, 0.0, 0.0), (bearing, 3, 1e-3, 1.0, 2.0, 0.0)],
)
def test_filter_is_filterpys_on_the_phantom(phantom, rest_state, alpha, beta, kappa, hx, m, sd):
    """Same points, one by one in plain NumPy there and in compiled batches here; 12 cycles of 1/120 s.

    1e-9 of metres, metres a second: rounding of two ways of solving with S, accumulated. Every fifth cycle has no
    measurement.
    """
    points = filterpy.kalman.MerweScaledSigmaPoints(16, alpha, beta, kappa)
    stepper, dt, rng = Stepper(phantom), 1.0 / 120.0, np.random.default_rng(1)
    P = np.diag(np.r_[np.full(8, 0.01**2), np.full(8, 0.1**2)])
    Q = np.diag(np.r_[np.full(8, 1e-9), np.full(8, 1e-4)])
    R = sd**2 * np.eye(m)
    stock = filterpy.kalman.UnscentedKalmanFilter(
        16, m, dt, lambda s: hx(s)[0], lambda s, dt: plain_step(phantom, s, dt, stepper.n_steps(dt)), points
    )
    started(stock, rest_state, P, Q)
    ours = started(UnscentedKalmanFilter(16, stepper.advance, hx, points), rest_state, P, Q)
    truth = rest_state + np.r_[0.01 * rng.normal(size=8), 0.1 * rng.normal(size=8)]
    for k in range(12):
        truth = stepper.advance(truth[None], dt)[0]
        z = None if k % 5 == 4 else hx(truth)[0] + sd * rng.normal(size=m)
        stock.predict()
        ours.predict(dt)
        np.testing.assert_allclose(ours.x, stock.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.P, stock.P, rtol=0, atol=1e-9)
        stock.update(z, R)
        ours.update(z, R)
        np.testing.assert_allclose(ours.x, stock.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.P, stock.P, rtol=0, atol=1e-9)
        if z is not None:
            np.testing.assert_allclose(ours.S, stock.S, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(ours.K, stock.K, rtol=0, atol=1e-8)
            assert ours.log_likelihood == pytest.approx(stock.log_likelihood, rel=0, abs=1e-6)
            assert ours.mahalanobis == pytest.approx(stock.mahalanobis, rel=1e-7)
            assert ours.likelihood == pytest.approx(stock.likelihood, rel=1e-6)


def linear_phantom(phantom, rest_state, dt):
    """Transition F of the phantom about its rest shape, its noise Q by acceleration steps, and the batched fx."""
    F = expm(state_matrix(phantom, phantom.positions) * dt)
    G = np.vstack([0.5 * dt**2 * np.eye(8), dt * np.eye(8)])
    Q = 0.5**2 * G @ G.T + 1e-12 * np.eye(16)
    return F, Q, lambda s, _dt: rest_state + (s - rest_state) @ F.T


def any_marks(phantom, rng):
    """Rows of any of the outer marks, none of them too, in any order."""
    nodes = [node for node in rng.permutation(OUTER) if rng.random() < 0.6]
    return [i for node in nodes for i in range(8)[phantom.coordinates(node)]]


def test_filter_is_the_textbook_kalman_filter_on_the_linear_phantom(phantom, rest_state):
    """Kalman (1960): x = F x, P = F P F' + Q; K = P H' S⁻¹, x + K y, (1 - K H) P. M2 is never seen; marks come and go.

    200 frames of 1/30 s. 1e-10 of 1 m, and of 1e-4 m² relative to the largest covariance: rounding.
    """
    dt, sd, rng = 1.0 / 30.0, 1e-3, np.random.default_rng(2)
    F, Q, fx = linear_phantom(phantom, rest_state, dt)
    P = np.diag(np.r_[np.full(8, 0.02**2), np.full(8, 0.2**2)])
    x, truth = np.zeros(16), np.linalg.cholesky(P) @ rng.normal(size=16)
    ours = started(UnscentedKalmanFilter(16, fx), rest_state, P, Q)
    sizes = set()
    for _ in range(200):
        truth = F @ truth + np.linalg.cholesky(Q) @ rng.normal(size=16)
        x, P = F @ x, F @ P @ F.T + Q
        ours.predict(dt)
        rows = any_marks(phantom, rng)
        sizes.add(len(rows))
        H, R = np.eye(16)[rows], sd**2 * np.diag(rng.uniform(0.5, 2.0, len(rows)))
        z = H @ truth + np.sqrt(R.diagonal()) * rng.normal(size=len(rows))
        if rows:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x, P = x + K @ (z - H @ x), (np.eye(16) - K @ H) @ P
        ours.update(z + H @ rest_state if rows else None, R, lambda s, H=H: s @ H.T)
        np.testing.assert_allclose(ours.x, x + rest_state, rtol=0, atol=1e-10)
        np.testing.assert_allclose(ours.P, P, rtol=0, atol=1e-10 * P.max())
    assert sizes == {0, 2, 4, 6}


def test_points_for_the_filter_all_weigh_the_same_but_the_centre():
    """Cubature: weight 1 / 2n on 2n points at sqrt(n) standard deviations, none on the centre."""
    points = positive_points(5)
    np.testing.assert_allclose(points.Wm, np.r_[0.0, np.full(10, 0.1)], rtol=0, atol=1e-16)
    np.testing.assert_allclose(points.Wc, np.r_[0.0, np.full(10, 0.1)], rtol=0, atol=1e-16)


INDEFINITE = np.array([[1.0, 2.0], [2.0, 1.0]])


@pytest.mark.parametrize(
    ("P", "act", "message"),
    [
        (INDEFINITE, lambda f: f.predict(1.0), "state covariance"),
        (INDEFINITE, lambda f: f.update(np.zeros(2), np.eye(2)), "state covariance"),
        (np.eye(2), lambda f: f.update(np.zeros(2), -2.0 * np.eye(2)), "innovation covariance"),
    ],
)
def test_a_covariance_that_is_not_definite_is_an_error_and_changes_nothing(P, act, message):
    """Style, rule 17: no hidden repair. The state before the error is the state after it."""
    f = started(UnscentedKalmanFilter(2, lambda s, _dt: s, lambda s: s), np.array([1.0, 2.0]), P, np.eye(2))
    with pytest.raises(CovarianceError, match=f"{message}: expected a positive definite matrix"):
        act(f)
    np.testing.assert_array_equal(f.x, [1.0, 2.0])
    np.testing.assert_array_equal(f.P, P)
