"""Interacting multiple models against filterpy's, the textbook's, and what rates mean."""

import filterpy.kalman
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from estimators import InteractingMixture, UnscentedKalmanFilter, moment_matched
from estimators.filters.mixture import nearest_definite
from estimators.filters.motion import Move
from estimators.filters.unscented import CovarianceError

RATES = np.array([[-0.4, 0.3, 0.1], [2.0, -3.0, 1.0], [0.5, 1.5, -2.0]])
MU = np.array([0.6, 0.3, 0.1])
QS = [1e-4, 1e-2, 1.0]
H, R = np.array([[1.0, 0.0]]), np.array([[0.05]])


def transition(dt):
    """A mass moving freely, (2, 2)."""
    return np.array([[1.0, dt], [0.0, 1.0]])


def noise(q, dt):
    """White acceleration of that density, (2, 2)."""
    return q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) + 1e-9 * np.eye(2)


def mixture(dt=0.1, mu=MU, rates=RATES):
    """Three modes that differ in the density of the acceleration."""
    filters = []
    for k, q in enumerate(QS):
        f = UnscentedKalmanFilter(2, lambda s, dt: s @ transition(dt).T)
        f.x, f.P, f.Q = np.array([0.1 * k, 0.5]), np.diag([1.0, 0.5 + k]), noise(q, dt)
        filters.append(f)
    return InteractingMixture(filters, mu, rates)


def measurements(n, rng):
    """A mass that stands, is thrown, and stands again, seen with noise."""
    path = np.interp(np.arange(n), [0, n // 3, 2 * n // 3, n], [0.0, 0.0, 8.0, 8.0])
    return path[:, None] + np.sqrt(R[0, 0]) * rng.normal(size=(n, 1))


def test_mixture_is_filterpys_at_one_frame_rate():
    """Stock IMMEstimator over stock Kalman filters with M = exp(rates dt): 100 cycles, 1e-9 of metres: rounding."""
    dt = 0.1
    ours = mixture(dt)
    stock_filters = []
    for f in ours.filters:
        kf = filterpy.kalman.KalmanFilter(dim_x=2, dim_z=1)
        kf.x, kf.P, kf.F, kf.Q, kf.H, kf.R = f.x.copy(), f.P.copy(), transition(dt), f.Q.copy(), H, R
        stock_filters.append(kf)
    stock = filterpy.kalman.IMMEstimator(stock_filters, MU.copy(), expm(RATES * dt))
    leading = set()
    for z in measurements(100, np.random.default_rng(0)):
        stock.predict()
        ours.predict(dt)
        np.testing.assert_allclose(ours.filters[1].x, stock.filters[1].x, rtol=0, atol=1e-9)
        stock.update(z)
        ours.update_linear(z, H, R)
        np.testing.assert_allclose(ours.mu, stock.mu, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.x, stock.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.P, stock.P, rtol=0, atol=1e-9)
        leading.add(int(ours.mu.argmax()))
    assert {0, 2} <= leading  # the modes do change places


def textbook_cycle(means, covs, mu, dt, z=None):
    """One cycle of [barshalom2001] 11.6.6: mixing (11.6.6-7 to -9), filtering, mode probabilities (11.6.6-15)."""
    p = expm(RATES * dt)
    predicted = p.T @ mu
    new_means, new_covs, likelihoods = [], [], []
    for j in range(3):
        w = p[:, j] * mu / predicted[j]
        x = sum(w[i] * means[i] for i in range(3))
        P = sum(w[i] * (covs[i] + np.outer(means[i] - x, means[i] - x)) for i in range(3))
        F = transition(dt)
        x, P = F @ x, F @ P @ F.T + noise(QS[j], dt)
        if z is not None:
            S = H @ P @ H.T + R
            likelihoods.append(multivariate_normal(H @ x, S).pdf(z))
            K = P @ H.T @ np.linalg.inv(S)
            x, P = x + K @ (z - H @ x), (np.eye(2) - K @ H) @ P
        new_means.append(x)
        new_covs.append(P)
    posterior = predicted if z is None else predicted * likelihoods / (predicted @ likelihoods)
    return new_means, new_covs, posterior


def test_mixture_is_the_textbook_one_with_frames_of_any_length_and_frames_unseen():
    """Cycle of `textbook_cycle`; every third frame brings nothing, intervals change by a factor of ten. Rounding."""
    rng, ours = np.random.default_rng(1), mixture()
    means, covs, mu = [f.x for f in ours.filters], [f.P for f in ours.filters], MU
    for k, z in enumerate(measurements(60, rng)):
        dt = rng.uniform(0.02, 0.2)
        for f, q in zip(ours.filters, QS, strict=True):
            f.Q = noise(q, dt)
        ours.predict(dt)
        if k % 3:
            ours.update_linear(z, H, R)
        means, covs, mu = textbook_cycle(means, covs, mu, dt, z if k % 3 else None)
        np.testing.assert_allclose(ours.mu, mu, rtol=0, atol=1e-10)
        np.testing.assert_allclose([f.x for f in ours.filters], means, rtol=0, atol=1e-9)
        np.testing.assert_allclose([f.P for f in ours.filters], covs, rtol=0, atol=1e-9)
        x = sum(m * mean for m, mean in zip(mu, means, strict=True))
        P = sum(m * (c + np.outer(a - x, a - x)) for m, a, c in zip(mu, means, covs, strict=True))
        np.testing.assert_allclose(ours.x, x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.P, P, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(ours.P, ours.P.T)


@pytest.mark.parametrize("frames", [1, 2, 12, 48])
def test_odds_without_data_do_not_depend_on_the_frame_rate(frames):
    """Kolmogorov: mu(t) = mu exp(rates t), however 0.2 s are cut. Steps count to 1e-13 s, rates are up to 3/s."""
    ours = mixture()
    for _ in range(frames):
        ours.predict(0.2 / frames)
    np.testing.assert_allclose(ours.mu, MU @ expm(0.2 * RATES), rtol=0, atol=1e-11)


def test_rates_of_nothing_leave_the_modes_alone():
    """exp(0) = 1: no mixing, three filters side by side, odds kept. Rounding."""
    ours = mixture(rates=np.zeros((3, 3)))
    alone = [transition(0.1) @ f.x for f in ours.filters]
    ours.predict(0.1)
    np.testing.assert_allclose([f.x for f in ours.filters], alone, rtol=0, atol=1e-15)
    np.testing.assert_allclose(ours.mu, MU, rtol=0, atol=1e-15)


def test_the_trace_of_a_prediction_is_what_a_smoother_needs():
    """Weights p_ij mu_i / c_j, moments of each mix, and the transition matrix of two steps of half the time. 1e-10."""
    ours, dt = mixture(), 0.1
    means, covs = [f.x for f in ours.filters], [f.P for f in ours.filters]
    ours.trace = []
    ours.predict(dt, 0.5 * dt)
    (found,) = ours.trace
    p, F = expm(RATES * dt), transition(0.5 * dt)
    np.testing.assert_allclose(found.arrived.mu, MU @ p, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.weights, p * MU[:, None] / (MU @ p), rtol=0, atol=1e-12)
    for j, q in enumerate(QS):
        w = p[:, j] * MU / (MU @ p)[j]
        x = sum(w[i] * means[i] for i in range(3))
        P = sum(w[i] * (covs[i] + np.outer(means[i] - x, means[i] - x)) for i in range(3))
        np.testing.assert_allclose(found.means[j], x, rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.covs[j], P, rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.F[j], transition(dt), rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.arrived.means[j], transition(dt) @ x, rtol=0, atol=1e-10)
        for _ in range(2):
            P = F @ P @ F.T + noise(q, dt)
        np.testing.assert_allclose(found.arrived.covs[j], P, rtol=0, atol=1e-10)


def test_columns_move_with_the_means_of_each_step():
    """By Euler's steps of 0.05 s of dc/dt = mean: c + 0.05 (m0 + m1), m1 the mean 0.05 s after m0. Rounding."""
    ours = mixture(rates=np.zeros((3, 3)))
    ours.columns = np.ones((3, 2, 1))
    ours.move = Move(ours.move.points, lambda means, columns, dt: columns + dt * means[:, :, None])
    before = np.array([f.x for f in ours.filters])
    ours.predict(0.1, 0.05)
    middle = before @ transition(0.05).T
    np.testing.assert_allclose(ours.columns[:, :, 0], 1.0 + 0.05 * (before + middle), rtol=0, atol=1e-12)


def test_the_likelihood_of_a_measurement_is_that_of_the_mixture():
    """Log of the sum of mu_i N(z; H x_i, H P_i H' + R), by SciPy. Rounding."""
    ours, z = mixture(), np.array([0.7])
    ours.predict(0.1)
    each = [multivariate_normal(H @ f.x, H @ f.P @ H.T + R).pdf(z) for f in ours.filters]
    expected = np.log(ours.mu @ each)
    ours.update_linear(z, H, R)
    assert ours.log_likelihood == pytest.approx(expected, rel=1e-12)


def test_only_indefinite_covariances_are_repaired_and_each_is_counted():
    """Of modes that do not mix: the others move as the textbook has it, F P F' + Q, to rounding."""
    ours = mixture(rates=np.zeros((3, 3)))
    assert ours.log_likelihood == 0.0
    for bad, counted in (((1,), 1), ((0, 2), 3)):
        before = [f.P.copy() for f in ours.filters]
        for k in bad:
            ours.filters[k].P = np.diag([1.0, -1e-3])
        ours.predict(0.1)
        assert ours.repairs["definite"] == counted
        for k, f in enumerate(ours.filters):
            assert np.linalg.eigvalsh(f.P).min() > 0.0
            if k not in bad:
                np.testing.assert_allclose(f.P, transition(0.1) @ before[k] @ transition(0.1).T + f.Q, rtol=1e-9)


def test_a_repaired_mode_moves_its_nearest_covariance_and_changes_no_other():
    """Of [[1, 2], [2, 1]], of eigenvalues 3 and -1, the first is left: 1.5 everywhere. Rounding; others to the bit."""
    ours, without = mixture(rates=np.zeros((3, 3))), mixture(rates=np.zeros((3, 3)))
    ours.filters[1].P = np.array([[1.0, 2.0], [2.0, 1.0]])
    for one in (ours, without):
        one.predict(0.1)
    expected = transition(0.1) @ np.full((2, 2), 1.5) @ transition(0.1).T + noise(QS[1], 0.1)
    np.testing.assert_allclose(ours.filters[1].P, expected, rtol=1e-10)
    for k in (0, 2):
        np.testing.assert_array_equal(ours.filters[k].P, without.filters[k].P)


def test_a_measurement_noise_that_is_none_is_rejected():
    message = r"^innovation covariance: expected positive definite, found otherwise$"
    with pytest.raises(CovarianceError, match=message):
        mixture().update_linear(np.zeros(1), H, -10.0 * np.eye(1))


def test_two_hopeless_modes_are_still_told_apart():
    """Odds of Bayes: log mu_i / mu_j = log prior odds + log likelihood ratio, where likelihoods are 0 in doubles.

    1e-9 of a log likelihood of thousands: rounding.
    """
    ours = mixture()
    ours.predict(0.1)
    prior, z = ours.mu.copy(), np.array([100.0])
    logs = np.array([multivariate_normal(H @ f.x, H @ f.P @ H.T + R).logpdf(z) for f in ours.filters])
    assert logs.max() < -745.0  # below the smallest double's logarithm
    ours.update_linear(z, H, R)
    odds = np.exp(logs - logs.max()) * prior
    np.testing.assert_allclose(ours.mu, odds / odds.sum(), rtol=1e-9, atol=1e-99)
    assert ours.mu.sum() == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("longest", "steps"), [(np.inf, 1), (0.1, 1), (0.05, 2), (0.03, 4), (0.1 / 3, 3), (0.1 / 95, 95)]
)
def test_modes_move_in_equal_steps_none_longer_than_allowed(longest, steps):
    """ceil(dt / longest) steps of dt / n, not one more for a rounding error; mixed once, before them."""
    taken = []

    def fx(states, dt):
        taken.append(dt)
        return states @ transition(dt).T

    ours = mixture()
    for f in ours.filters:
        f.fx = fx
    ours.predict(0.1, longest)
    np.testing.assert_allclose(taken, np.full(3 * steps, 0.1 / steps), rtol=1e-15)


def test_moments_of_a_mixture_of_two():
    """Mean m = w1 m1 + w2 m2, P = w1 P1 + w2 P2 + w1 w2 (m1 - m2)(m1 - m2)': total variance. Rounding."""
    rng = np.random.default_rng(2)
    means, roots = rng.normal(size=(2, 3)), rng.normal(size=(2, 3, 3))
    covs = roots @ roots.transpose(0, 2, 1)
    mean, cov = moment_matched(np.array([0.3, 0.7]), means, covs)
    apart = means[0] - means[1]
    np.testing.assert_allclose(mean, 0.3 * means[0] + 0.7 * means[1], rtol=0, atol=1e-15)
    expected = 0.3 * covs[0] + 0.7 * covs[1] + 0.21 * np.outer(apart, apart)
    np.testing.assert_allclose(cov, expected, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(cov, cov.T)


def test_moments_of_equal_parts_are_theirs():
    mean, cov = moment_matched(MU, np.tile([1.0, 2.0], (3, 1)), np.tile(np.diag([3.0, 4.0]), (3, 1, 1)))
    np.testing.assert_allclose(mean, [1.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(cov, np.diag([3.0, 4.0]), rtol=0, atol=1e-14)


def test_a_restart_gives_every_mode_the_same_belief_and_keeps_the_odds():
    """Mean and covariance of equal parts are theirs; modes share no array. Rounding."""
    ours, mean, cov = mixture(), np.array([5.0, 6.0]), np.diag([7.0, 8.0])
    ours.restart(mean, cov)
    for f in ours.filters:
        np.testing.assert_array_equal(f.x, [5.0, 6.0])
        np.testing.assert_array_equal(f.P, np.diag([7.0, 8.0]))
    ours.filters[0].x += 1.0
    ours.filters[0].P += 1.0
    np.testing.assert_array_equal(ours.filters[1].x, [5.0, 6.0])
    np.testing.assert_array_equal(ours.filters[1].P, np.diag([7.0, 8.0]))
    np.testing.assert_array_equal(mean, [5.0, 6.0])
    np.testing.assert_allclose(ours.x, [5.0, 6.0], rtol=1e-15)
    np.testing.assert_allclose(ours.P, np.diag([7.0, 8.0]), rtol=0, atol=1e-14)
    np.testing.assert_allclose(ours.mu, MU, rtol=1e-15)


def test_a_restart_without_columns_keeps_those_of_the_first_mode():
    """The total covariance, with C C' of those, is every mode's. Rounding."""
    ours = mixture()
    ours.columns = np.arange(1.0, 7.0).reshape(3, 2, 1)
    ours.restart(np.zeros(2), np.eye(2))
    np.testing.assert_array_equal(ours.columns, np.tile([[1.0], [2.0]], (3, 1, 1)))
    np.testing.assert_allclose(ours.P, [[2.0, 2.0], [2.0, 5.0]], rtol=0, atol=1e-14)


@pytest.mark.parametrize(("n", "correlation"), [(4, 1.0), (3, -0.6)])
def test_the_least_eigenvalue_of_a_mended_covariance_is_a_share_of_the_largest(n, correlation):
    """All pairs correlated by r: n - 1 eigenvalues 1 - r and one 1 + (n - 1) r; the least becomes 1e-12 of the largest.

    The largest stays; units of powers of two do not matter. 1e-3 of 1e-12: rounding of the largest.
    """
    same = np.full((n, n), correlation) + (1.0 - correlation) * np.eye(n)
    units = 2.0 ** np.array([-20.0, 0.0, 10.0, 3.0])[:n]
    mended = nearest_definite(same * np.outer(units, units)) / np.outer(units, units)
    values, largest = np.linalg.eigvalsh(mended), max(1.0 - correlation, 1.0 + (n - 1) * correlation)
    assert values[0] == pytest.approx(1e-12 * largest, rel=1e-3, abs=0.0)
    assert values[-1] == pytest.approx(largest, rel=1e-12)
