"""Whether a breath holds: its probability, and a target that leaves it."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators import Breathing, BreathingSettings
from tests.estimators.guidance.test_breathing import FRAME_S, TURN, fed, wave


def walked_off(times, offs, error_covs, steps, lasting_s):
    """Probability that the breath holds after each estimate, by joint Gaussian densities of all distances at once.

    Either they are errors alone, each of its covariance, or errors about a random walk, which begins at none and whose
    variance grows by `steps`; the breath is left at the hazard 1 / lasting_s [adams2007].
    """
    dim, grown = offs.shape[1], np.cumsum(steps)
    walk = np.minimum(grown[:, None], grown)

    def log_density(n, walks):
        cov = np.kron(walk[:n, :n] if walks else np.zeros((n, n)), np.eye(dim))
        for k in range(n):
            cov[dim * k : dim * (k + 1), dim * k : dim * (k + 1)] += error_covs[k]
        return multivariate_normal(np.zeros(dim * n), cov).logpdf(offs[:n].ravel())

    holds, before, found = 1.0, np.zeros(2), []
    for k, waited_s in enumerate(np.diff(times)):
        now = np.array([log_density(k + 1, False), log_density(k + 1, True)])
        stays = holds * np.exp(-waited_s / lasting_s)
        likely = np.array([stays, 1.0 - stays]) * np.exp(now - before)
        holds, before = likely[0] / likely.sum(), now
        found.append(holds)
    return found


@pytest.mark.parametrize("shift_m", [0.0, 4e-3])
def test_the_probability_that_the_breath_holds_is_that_of_two_hypotheses(shift_m):
    """Against `walked_off`, 1e-8; estimates 0.2 s apart, errors independent, a target that shifts or does not."""
    rng = np.random.default_rng(11)
    settings = BreathingSettings(n_periods=20, memory_s=1e9, lasting_s=30.0, forgotten=1e-300)
    breathing, track = Breathing(2, settings), []
    times, offs, covs, steps, found = [], [], [], [], []
    for t in np.arange(0.0, 11.0, settings.alike_s):
        cov = np.diag([1e-6, 2e-6]) * rng.uniform(0.5, 1.5)
        seen = wave(t, 4.2) + np.linalg.cholesky(cov) @ rng.normal(size=2) + (shift_m * TURN if t > 9.0 else 0.0)
        breath = breathing.breath()
        if breath is not None:
            means, spread = breathing.predict(np.array([t]))
            offs.append(seen - means[0])
            covs.append(spread[0] + cov)
            steps.append(np.var(track, axis=0).mean() * settings.alike_s / breath.period_s)
            times.append(t)
        breathing.update(float(t), seen, cov)
        track.append(seen)
        if breath is not None:
            found.append(breathing.holds(np.array([t]))[0])
    expected = walked_off([times[0] - settings.alike_s, *times], np.array(offs), covs, steps, settings.lasting_s)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    assert (min(found) < 0.5) == (shift_m > 0.0)


def test_estimates_alike_count_as_one():
    """Ten times as many estimates of the same errors within 0.2 s (alike_s): log odds alike by half."""
    found = []
    for n in (1, 10):
        rng = np.random.default_rng(12)
        breathing = Breathing(2, BreathingSettings(n_periods=20, forgotten=1e-300))
        for t in np.arange(0.0, 10.0, 0.2):
            error = 1e-3 * rng.normal(size=2)
            for k in range(n):
                at = float(t + 0.2 * k / n)
                off = 5e-3 * TURN if t > 9.1 else 0.0
                breathing.update(at, wave(at, 4.2) + error + off, 1e-6 * np.eye(2))
        found.append(breathing.holds(np.array([at]))[0])
    one, ten = np.log(found) - np.log1p(-np.array(found))
    assert one < -3.0
    assert ten == pytest.approx(one, rel=0.5)


def test_a_breath_is_left_by_chance_later_on():
    """A share of exp(-t / lasting_s) of what it is now; without a breath it does not hold."""
    breathing = fed(4.0, 12.0, 1e-3, np.random.default_rng(4), BreathingSettings(lasting_s=20.0))
    now, later = breathing.holds(12.0 - FRAME_S + np.array([0.0, 5.0]))
    assert 0.9 < now < 1.0
    assert later == pytest.approx(now * np.exp(-0.25), rel=1e-12)
    np.testing.assert_array_equal(Breathing(2).holds(np.array([0.0, 1.0])), [0.0, 0.0])


@pytest.mark.parametrize(
    ("left", "within_s"),
    [
        (lambda t: wave(t, 4.0) + np.array([0.0, 0.012]), 0.4),
        (lambda t: np.broadcast_to(wave(12.0, 4.0), (*np.shape(t), 2)), 0.6),
        (lambda t: wave(12.0 + (t - 12.0) / 1.5, 4.0), 1.5),
    ],
    ids=["shifts", "is held", "slows down"],
)
def test_a_target_that_leaves_its_breath_is_noticed_and_the_new_one_found(left, within_s):
    """From 12 s on, errors of 1 mm: improbable within that time; where it breathes, predicted 18 s later to 1 mm."""
    rng = np.random.default_rng(9)
    breathing, noticed = Breathing(2), np.inf
    for t in np.arange(0.0, 30.0, 3.0 * FRAME_S):
        true = wave(t, 4.0) if t < 12.0 else left(t)
        breathing.update(float(t), true + 1e-3 * rng.normal(size=2), 1e-6 * np.eye(2))
        if t < 12.0:
            before = breathing.holds(np.array([t]))[0]
        elif breathing.holds(np.array([t]))[0] < 0.5:
            noticed = min(noticed, t - 12.0)
    assert 0.0 <= noticed < within_s
    assert before > 0.9
    ahead = np.array([30.0, 30.5])
    breathes = bool((left(ahead[0]) != left(ahead[1])).any())
    assert (breathing.breath() is not None) == breathes
    if breathes:
        assert np.abs(breathing.predict(ahead)[0] - left(ahead)).max() < 1e-3
