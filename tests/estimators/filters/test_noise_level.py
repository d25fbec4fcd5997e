"""The level of process noise, learnt while running: its score is the slope of the likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators.filters.noise_level import NoiseLevel

DT = 1.0 / 30.0
F = np.array([[1.0, DT], [-4.0 * DT, 1.0 - 0.2 * DT]])
WHITE = np.array([[DT**3 / 3.0, DT**2 / 2.0], [DT**2 / 2.0, DT]])
H, SD = np.array([[1.0, 0.0]]), 1e-3


def riccati(P, level, sd=SD):
    """One step and one update of a Kalman filter: y's covariance, gain, and the covariance after it."""
    P = F @ P @ F.T + level * WHITE
    S = H @ P @ H.T + sd**2
    K = P @ H.T @ np.linalg.inv(S)
    return S, K, P - K @ S @ K.T


def followed(levels, seconds, rng, true, sd=SD):
    """An oscillator whose force is white of this density, seen by a filter whose level is learnt."""
    x = np.zeros(2)
    belief, P = np.zeros(2), np.zeros((2, 2))
    root = np.linalg.cholesky(WHITE)
    for _ in range(round(seconds / DT)):
        x = F @ x + np.sqrt(true) * root @ rng.normal(size=2)
        levels.predicted(F, levels.scale * WHITE, DT)
        y = H @ (x - F @ belief) + sd * rng.normal(size=1)
        S, K, P = riccati(P, levels.scale, sd)
        belief = F @ belief + K @ y
        levels.learn((y, S, K), H)
    return levels


def level(bounds=(1e-3, 1e3)):
    return NoiseLevel(bounds, 2)


def filtered(seen, level):
    """Log density of each of the measurements (n, 1), and the belief's mean and covariance after them."""
    x, P, logs = np.zeros(2), np.zeros((2, 2)), []
    for z in seen:
        x = F @ x
        S, K, P = riccati(P, level)
        logs.append(multivariate_normal.logpdf(z, H @ x, S))
        x = x + K @ (z - H @ x)
    return np.array(logs), x, P


def test_its_score_is_the_slope_of_the_likelihood():
    """By central differences of whole filters over 41 frames, 1e-4 of the logarithm each way: 1e-5 of the largest."""
    seen = np.cumsum(np.random.default_rng(4).normal(0.0, 3e-3, (41, 1)), axis=0)
    levels, x, P = level((1.0, 1.0)), np.zeros(2), np.zeros((2, 2))
    plus, minus = filtered(seen, np.exp(1e-4)), filtered(seen, np.exp(-1e-4))
    scores = []
    for z in seen:
        levels.predicted(F, WHITE, DT)
        x = F @ x
        S, K, P = riccati(P, 1.0)
        once = level()
        once.resume(replace(levels.state, information=1e6))
        once.learn((z - H @ x, S, K), H)
        scores.append(np.log(once.scale) * once.state.information)
        levels.learn((z - H @ x, S, K), H)
        x = x + K @ (z - H @ x)
    wanted = (plus[0] - minus[0]) / 2e-4
    np.testing.assert_allclose(scores, wanted, rtol=0.0, atol=1e-5 * np.abs(wanted).max())
    for found, k in ((levels.state.mean_slope, 1), (levels.state.cov_slope, 2)):
        slope = (plus[k] - minus[k]) / 2e-4
        np.testing.assert_allclose(found, slope, rtol=0.0, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize("true", [0.1, 1.0, 10.0])
def test_it_learns_the_level_that_is_there(true):
    """Mean logarithm of six runs of 20 s within 0.3: the stated level, 1, counts for little by then."""
    logs = [np.log(followed(level(), 20.0, np.random.default_rng(seed), true).scale / true) for seed in range(6)]
    assert abs(np.mean(logs)) < 0.3
    assert np.std(logs) < 0.4


@pytest.mark.parametrize(("true", "low", "high"), [(1 / 16, 0.0, 0.3), (1.0, 0.8, 1.5)])
def test_a_level_that_is_far_off_is_left_within_seconds_where_marks_are_coarse(true, low, high):
    """Noise of 0.3 m at 8 s of an oscillator that swings 0.2 m by a sixteenth of the stated level, 0.8 m by all of it.

    Innovations one by one hardly tell: their score alone left the first at 0.7.
    """
    found = [followed(level(), 8.0, np.random.default_rng(seed), true, sd=0.3).scale for seed in range(6)]
    assert low < np.exp(np.mean(np.log(found))) < high


def test_a_belief_that_became_narrower_otherwise_is_not_all_of_the_level():
    """A sensitivity as it was before a restart: it counts as the whole covariance of the innovation, and no more."""
    levels = followed(level(), 2.0, np.random.default_rng(0), 1.0)
    before = levels.state
    S = H @ before.cov_slope @ H.T / 100.0
    levels.learn((np.zeros(1), S, np.zeros((2, 1))), H)
    # half of a coordinate, and what the mean's derivative, as much smaller, tells of it
    told = 0.5 + float((H @ before.mean_slope)[0] / 100.0) ** 2 / S[0, 0]
    assert levels.state.information <= before.information + told
    np.testing.assert_allclose(levels.state.mean_slope, before.mean_slope / 100.0, rtol=1e-12)
    np.testing.assert_allclose(levels.state.cov_slope, before.cov_slope / 100.0, rtol=1e-12)


def test_it_stays_within_its_bounds_and_goes_back_to_what_it_was():
    levels = followed(level((0.5, 2.0)), 20.0, np.random.default_rng(0), 100.0)
    assert levels.scale == 2.0
    then = levels.state
    followed(levels, 20.0, np.random.default_rng(1), 0.01)
    assert levels.scale < 2.0
    levels.resume(then)
    assert levels.scale == 2.0
    np.testing.assert_array_equal(levels.state.cov_slope, then.cov_slope)


def test_a_belief_that_is_another_owes_nothing_to_the_level():
    levels = followed(level(), 2.0, np.random.default_rng(0), 1.0)
    assert np.abs(levels.state.cov_slope).max() > 0.0
    assert np.abs(levels.state.mean_slope).max() > 0.0
    levels.forget()
    assert np.abs(levels.state.cov_slope).max() == 0.0
    assert np.abs(levels.state.mean_slope).max() == 0.0
