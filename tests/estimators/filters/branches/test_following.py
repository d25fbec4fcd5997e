"""Branches taken apart, put together and merged, against total variance."""

import numpy as np

from estimators import InteractingMixture, UnscentedKalmanFilter
from estimators.filters.branches import ALIKE, branches_of, follow, merge_alike
from estimators.filters.motion import Cycle, LinearMotion

RATES = np.array([[-0.5, 0.5, 0.0], [0.2, -2.2, 2.0], [3.0, 1.0, -4.0]])
OF_STATE = (0, 0, 1)
ODDS = np.array([0.5, 0.3, 0.2])
LEFT = (np.array([-1.0, 0.2]), np.array([[0.5, 0.1], [0.1, 0.3]]), np.array([[0.1], [0.2]]))
RIGHT = (np.array([9.0, -0.1]), np.array([[0.2, 0.0], [0.0, 0.9]]), np.array([[-0.3], [0.0]]))
NEAR = (LEFT[0] + np.array([0.3, 0.0]), 1.2 * LEFT[1], LEFT[2] + 0.1)


def mixture(*beliefs: tuple[np.ndarray, np.ndarray, np.ndarray], odds: list[float]) -> InteractingMixture:
    filters = [UnscentedKalmanFilter(2, lambda s, _dt: s) for _ in range(2)]
    made = InteractingMixture(filters, ODDS, RATES, of_state=OF_STATE)
    made.columns = np.zeros((2, 2, 1))
    made.branch(beliefs, np.array(odds))
    for k, f in enumerate(made.filters):  # modes that differ
        f.x = f.x + 0.1 * (k % 2)
        f.P = f.P * (1.0 + 0.5 * (k % 2))
    return made


def never(_about: np.ndarray) -> LinearMotion:
    raise AssertionError


def test_what_is_taken_apart_and_put_together_is_as_before():
    made = mixture(LEFT, RIGHT, odds=[0.7, 0.3])
    odds, now, columns = made.chain.odds.copy(), made.beliefs(), made.columns.copy()
    parts = branches_of(made)
    still = LinearMotion(now.means, now.covs, now.covs, columns, columns, 2, np.zeros(now.means.shape[1]))
    made.cycle = Cycle(now.means, now.covs, now.covs, columns, never, 1, now.means, still, 0.1, 0)
    follow(made, parts[::-1])
    assert made.n_branches == 2
    assert made.cycle is None  # what was predicted is not what is followed
    np.testing.assert_allclose(made.branch_odds, [0.3, 0.7], rtol=1e-12)
    np.testing.assert_array_equal(made.filters[0].x, now.means[2])
    follow(made, branches_of(made)[::-1])
    np.testing.assert_allclose(made.chain.odds, odds, rtol=1e-12)
    np.testing.assert_array_equal(made.beliefs().means, now.means)
    np.testing.assert_array_equal(made.beliefs().covs, now.covs)
    np.testing.assert_array_equal(made.columns, columns)


def test_the_whole_is_by_total_variance():
    """Of three branches in place of two; rounding."""
    made = mixture(LEFT, RIGHT, odds=[0.7, 0.3])
    left, right = branches_of(made)
    follow(made, [left, right, right.scaled(0.5 * right.odds)])
    assert len(made.filters) == 6
    mu, now = made.mu, made.beliefs()
    np.testing.assert_allclose(made.branch_odds, np.array([0.7, 0.3, 0.15]) / 1.15, rtol=1e-12)
    mean = mu @ now.means
    apart = now.means - mean
    cov = np.einsum("k,kij->ij", mu, now.covs + apart[:, :, None] * apart[:, None, :])
    cov += np.einsum("k,kir,kjr->ij", mu, made.columns, made.columns)
    np.testing.assert_allclose(made.x, mean, rtol=1e-12)
    np.testing.assert_allclose(made.P, cov, rtol=1e-12)


def test_branches_that_became_the_same_are_one():
    """Two of three: their odds add up, each mode has the moments of both, the third is as it was. Rounding."""
    made = mixture(LEFT, RIGHT, NEAR, odds=[0.5, 0.3, 0.2])
    first, other, second = branches_of(made)
    merge_alike(made)
    assert made.n_branches == 2
    assert made.repairs["merged"] == 1
    np.testing.assert_allclose(made.branch_odds, [0.7, 0.3], rtol=1e-12)
    for k in range(2):
        both = [first.odds[np.array(OF_STATE) == k].sum(), second.odds[np.array(OF_STATE) == k].sum()]
        share = np.array(both) / np.sum(both)
        mean = share[0] * first.means[k] + share[1] * second.means[k]
        columns = share[0] * first.columns[k] + share[1] * second.columns[k]
        cov = np.zeros((2, 2))
        for w, each in zip(share, (first, second), strict=True):
            apart, beside = each.means[k] - mean, each.columns[k] - columns
            cov += w * (each.covs[k] + np.outer(apart, apart) + beside @ beside.T)
        whole = made.filters[k]
        np.testing.assert_allclose(whole.x, mean, rtol=1e-12)
        np.testing.assert_allclose(whole.P, cov, rtol=1e-12)
        np.testing.assert_array_equal(made.filters[2 + k].x, other.means[k])


def test_branches_further_apart_than_both_allow_stay_apart():
    """On either side of a squared distance of 0.5, by the sum of the covariances of both."""
    for factor, n in ((0.98, 1), (1.02, 2)):
        way = np.array([1.0, -1.0])
        length = np.sqrt(factor * ALIKE / (way @ np.linalg.solve(2.0 * LEFT[1], way)))
        made = InteractingMixture(
            [UnscentedKalmanFilter(2, lambda s, _dt: s) for _ in range(2)], ODDS[1:], RATES[1:, 1:]
        )
        made.branch([LEFT, (LEFT[0] + length * way, *LEFT[1:])], np.array([0.5, 0.5]))
        merge_alike(made)
        assert made.n_branches == n
