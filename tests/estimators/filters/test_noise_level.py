"""The level of process noise, learnt while running: its sensitivity is the derivative of Riccati's equation."""

import numpy as np
import pytest

from estimators.filters.noise_level import NoiseLevel

DT = 1.0 / 30.0
F = np.array([[1.0, DT], [-4.0 * DT, 1.0 - 0.2 * DT]])
WHITE = np.array([[DT**3 / 3.0, DT**2 / 2.0], [DT**2 / 2.0, DT]])
H, R = np.array([[1.0, 0.0]]), np.array([[1e-6]])


def riccati(P, level):
    """One step and one update of a Kalman filter: y's covariance, gain, and the covariance after it."""
    P = F @ P @ F.T + level * WHITE
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return S, K, P - K @ S @ K.T


def followed(levels, seconds, rng, true, lasting_s=0.0):
    """An oscillator whose force is white of this density, or lasts, seen by a filter whose level is learnt."""
    x, force = np.zeros(2), 0.0
    belief, P = np.zeros(2), np.zeros((2, 2))
    root = np.linalg.cholesky(WHITE)
    fade = np.exp(-DT / lasting_s) if lasting_s else 0.0
    for _ in range(round(seconds / DT)):
        if lasting_s:
            force = fade * force + np.sqrt((1.0 - fade**2) * true) * rng.normal()
            x = F @ x + np.array([0.5 * DT**2, DT]) * force
        else:
            x = F @ x + np.sqrt(true) * root @ rng.normal(size=2)
        levels.predicted(F, levels.scale * WHITE, DT)
        y = H @ (x - F @ belief) + 1e-3 * rng.normal(size=1)
        S, K, P = riccati(P, levels.scale)
        belief = F @ belief + K @ y
        levels.learn((y, S, K), H)
    return levels


def level(bounds=(1e-3, 1e3)):
    return NoiseLevel(bounds, 2)


def test_its_sensitivity_is_the_derivative_of_the_covariance():
    """By central differences of the whole recursion over 40 frames, 1e-4 of the logarithm each way: 1e-6 of it."""
    kept, plus, minus = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2))
    fixed = level((1.0, 1.0))
    for _ in range(40):
        fixed.predicted(F, WHITE, DT)
        S, K, kept = riccati(kept, 1.0)
        fixed.learn((np.zeros(1), S, K), H)
        plus, minus = riccati(plus, np.exp(1e-4))[2], riccati(minus, np.exp(-1e-4))[2]
    wanted = (plus - minus) / 2e-4
    np.testing.assert_allclose(fixed.state.sensitivity, wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.parametrize("true", [0.1, 1.0, 10.0])
def test_it_learns_the_level_that_is_there(true):
    """Mean logarithm of twelve runs of a minute within 0.3: the stated level, 1, counts for little by then."""
    logs = [np.log(followed(level(), 60.0, np.random.default_rng(seed), true).scale / true) for seed in range(12)]
    assert abs(np.mean(logs)) < 0.3
    assert np.std(logs) < 0.6


def test_forces_that_last_count_as_they_add_up():
    """A force of 0.2 s correlation: more than by innovations one by one, of which each shows little of it."""
    at_once, summed = [], []
    for seed in range(6):
        single = NoiseLevel((1e-3, 1e3), 2, colour_s=0.0)
        at_once.append(followed(single, 30.0, np.random.default_rng(seed), 1.0, lasting_s=0.2).scale)
        summed.append(followed(level(), 30.0, np.random.default_rng(seed), 1.0, lasting_s=0.2).scale)
    assert np.mean(np.log(summed)) > np.mean(np.log(at_once)) + 0.1


def test_a_belief_that_became_narrower_otherwise_is_not_all_of_the_level():
    """A sensitivity as it was before a restart: it counts as the whole covariance of the innovation, and no more."""
    levels = followed(level(), 2.0, np.random.default_rng(0), 1.0)
    before = levels.state
    S = H @ before.sensitivity @ H.T / 100.0
    levels.learn((np.zeros(1), S, np.zeros((2, 1))), H)
    assert levels.state.information <= before.information + 0.5
    np.testing.assert_allclose(levels.state.sensitivity, before.sensitivity / 100.0, rtol=1e-12)


def test_it_stays_within_its_bounds_and_goes_back_to_what_it_was():
    levels = followed(level((0.5, 2.0)), 20.0, np.random.default_rng(0), 100.0)
    assert levels.scale == 2.0
    then = levels.state
    followed(levels, 20.0, np.random.default_rng(1), 0.01)
    assert levels.scale < 2.0
    levels.resume(then)
    assert levels.scale == 2.0
    np.testing.assert_array_equal(levels.state.sensitivity, then.sensitivity)


def test_a_belief_that_is_another_owes_nothing_to_the_level():
    levels = followed(level(), 2.0, np.random.default_rng(0), 1.0)
    assert np.abs(levels.state.sensitivity).max() > 0.0
    assert levels.state.earlier
    levels.forget()
    assert np.abs(levels.state.sensitivity).max() == 0.0
    assert levels.state.earlier == ()
