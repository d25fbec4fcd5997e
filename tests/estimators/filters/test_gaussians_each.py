"""Beliefs of a target: inflated, pooled with another opinion, corrected by a third, and made more even."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.filters.gaussians import corrected_each, evened_each, inflated_each, moment_matched, pooled_each


def test_a_correction_is_the_kalman_update_of_a_state_with_its_considered_errors():
    """By the joint state of x and the errors, whose gain is kept at nought; inflated before, all of it is larger."""
    rng = np.random.default_rng(1)
    x, C, A = rng.normal(size=5), rng.normal(size=(5, 2)), rng.normal(size=(5, 5))
    P, H, R, z = A @ A.T, rng.normal(size=(2, 5)), np.diag([0.3, 0.5]), rng.normal(size=2)
    inflated = inflated_each(np.ones(1), (x[None], P[None], C[None]), 1.7)
    P, C = 1.7 * P, np.sqrt(1.7) * C
    S = H @ (P + C @ C.T) @ H.T + R
    K = (P + C @ C.T) @ H.T @ np.linalg.inv(S)
    keep = np.eye(5) - K @ H
    xs, Ps, columns = corrected_each(inflated, z, H, R)
    np.testing.assert_allclose(xs[0], x + K @ (z - H @ x), rtol=1e-10)
    np.testing.assert_allclose(Ps[0], keep @ P @ keep.T + K @ R @ K.T, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(columns[0], keep @ C, rtol=1e-10, atol=1e-12)
    total = Ps[0] + columns[0] @ columns[0].T
    np.testing.assert_allclose(total, keep @ (P + C @ C.T), rtol=1e-9, atol=1e-12)


def mixed_cov(weights, beliefs):
    """Covariance of a mixture, that of considered errors with it."""
    xs, Ps, columns = beliefs
    return moment_matched(weights, xs, Ps + columns @ columns.swapaxes(1, 2))[1]


@given(share=st.floats(0.0, 1.0), seed=st.integers(0, 99))
def test_a_covariance_is_made_even_at_a_target_by_a_share_and_the_rest_follows_by_regression(share, seed):
    """By the moments of the mixture: the trace stays, what does not depend on H x stays, and so does the mean."""
    rng = np.random.default_rng(seed)
    A, H, weights = rng.normal(size=(3, 5, 5)), rng.normal(size=(2, 5)), rng.dirichlet(np.ones(3))
    beliefs = rng.normal(size=(3, 5)), A @ A.swapaxes(1, 2), rng.normal(size=(3, 5, 2))
    found = evened_each(weights, beliefs, H, share)
    np.testing.assert_allclose(weights @ found[0], weights @ beliefs[0], rtol=1e-9, atol=1e-12)
    before, after = mixed_cov(weights, beliefs), mixed_cov(weights, found)
    at, size = H @ before @ H.T, np.trace(before)
    wanted = (1.0 - share) * at + share * np.trace(at) / 2.0 * np.eye(2)
    np.testing.assert_allclose(H @ after @ H.T, wanted, rtol=0.0, atol=1e-9 * size)
    along = before @ H.T @ np.linalg.inv(at)
    np.testing.assert_allclose(
        after - along @ wanted @ along.T, before - along @ at @ along.T, rtol=0.0, atol=1e-7 * size
    )
    assert all(np.linalg.eigvalsh(P)[0] > -1e-9 * size for P in found[1])


def test_a_place_that_is_trusted_more_keeps_the_covariance_of_the_errors_that_are_left():
    """The gain is that of a covariance 1.7 times smaller, the covariance Joseph's of the one that was given."""
    rng = np.random.default_rng(2)
    x, A, H = rng.normal(size=4), rng.normal(size=(4, 4)), rng.normal(size=(2, 4))
    P, R, z = 0.1 * A @ A.T, np.diag([0.4, 0.2]), rng.normal(size=2)
    K = P / 1.7 @ H.T @ np.linalg.inv(H @ P @ H.T / 1.7 + R)
    keep = np.eye(4) - K @ H
    xs, Ps, _ = corrected_each((x[None], P[None], np.zeros((1, 4, 0))), z, H, R, trust=1.7)
    np.testing.assert_allclose(xs[0], x + K @ (z - H @ x), rtol=1e-10)
    np.testing.assert_allclose(Ps[0], keep @ P @ keep.T + K @ R @ K.T, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize(("size", "bound"), [(9.0, "half of its own"), (900.0, "the best mean")])
def test_a_place_that_is_trusted_too_much_leaves_no_more_than_the_mean_of_two(size, bound):
    """Joseph's covariance is larger, by the traces, at a trust of 30; all is told smaller by one factor then.

    To half of the place's own, or to what the best mean of it and of errors 30 times smaller leaves, if that is more.
    """
    P, H, C = np.diag([size, 7.0, 3.0]), np.eye(2, 3), np.array([[[1.0], [0.5], [0.2]]])
    R, z, trust = 0.5 * np.eye(2), np.array([1.0, -2.0]), 30.0
    whole = P + C[0] @ C[0].T
    K = whole @ H.T @ np.linalg.inv(H @ whole @ H.T + trust * R)
    keep = np.eye(3) - K @ H
    left, of_columns = keep @ P @ keep.T + K @ R @ K.T, keep @ C[0]
    at_z = np.trace(H @ (left + of_columns @ of_columns.T) @ H.T)
    best = np.trace(np.linalg.inv(trust * np.linalg.inv(H @ whole @ H.T) + np.linalg.inv(R)))
    most = {"half of its own": 0.5 * np.trace(R), "the best mean": best}[bound]
    assert at_z > most >= max(best, 0.5 * np.trace(R)) - 1e-12
    xs, Ps, columns = corrected_each((np.zeros((1, 3)), P[None], C), z, H, R, trust=trust)
    np.testing.assert_allclose(xs[0], K @ z, rtol=1e-10)
    np.testing.assert_allclose(Ps[0], left * most / at_z, rtol=1e-10)
    np.testing.assert_allclose(columns[0], of_columns * np.sqrt(most / at_z), rtol=1e-10)


@given(sizes=st.tuples(*3 * [st.floats(0.01, 100.0)]), seed=st.integers(0, 99))
def test_a_place_that_is_trusted_as_its_covariance_says_leaves_the_best_mean(sizes, seed):
    """Kalman's covariance, whole: the inverse of both information matrices together."""
    A = np.random.default_rng(seed).normal(size=(3, 3)) + 3.0 * np.eye(3)
    P, R, H = A @ np.diag(sizes) @ A.T, np.diag(sizes[::-1]), np.eye(3)
    _, Ps, _ = corrected_each((np.zeros((1, 3)), P[None], np.zeros((1, 3, 0))), np.ones(3), H, R)
    best = np.linalg.inv(np.linalg.inv(P) + np.linalg.inv(R))
    np.testing.assert_allclose(Ps[0], best, rtol=1e-5, atol=1e-7)


def test_a_belief_that_is_pooled_has_mean_and_spread_of_the_mixture_of_both():
    rng = np.random.default_rng(4)
    x, A, ahead = rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=3)
    P, C = A @ A.T, rng.normal(size=(1, 3, 2))
    xs, Ps, columns = pooled_each((x[None], P[None], C), ahead, 0.3)
    mean, cov = moment_matched(np.array([0.7, 0.3]), np.stack([x, x + ahead]), np.stack([P, P]))
    np.testing.assert_allclose(xs[0], mean, rtol=1e-12)
    np.testing.assert_allclose(Ps[0], cov, rtol=1e-12)
    np.testing.assert_array_equal(columns, C)
