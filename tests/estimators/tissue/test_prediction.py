"""What the filter says of the target at a later moment, when a needle would arrive."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import HIDDEN, OUTER
from estimators import UnifiedFilter, coverage, moment_matched, normalised_error_squared

FRAME_S = 4 / 120.0
AHEAD_S = 0.2


@pytest.fixture(scope="module")
def after_two_seconds(phantom, rest_state, driven, poke_forces, marks_of):
    """A filter that followed a poked phantom for two seconds."""
    rng = np.random.default_rng(4)
    states = driven(phantom, rest_state, poke_forces(phantom, 2.0, rng))
    tissue = UnifiedFilter(phantom, HIDDEN, OUTER)
    for k, state in enumerate(states[::4]):
        tissue.predict(k * FRAME_S)
        tissue.update(marks_of(phantom, state, 1e-3, rng))
    return tissue


@pytest.fixture
def followed(after_two_seconds):
    """A copy of that filter."""
    return deepcopy(after_two_seconds)


def test_it_is_what_the_filter_would_say_without_marks_until_then(followed):
    """predict_at(t) against predict(t) and update of no mark: the same operations, so to the last bit."""
    at = followed.time_s + AHEAD_S
    ahead = followed.predict_at(at)
    followed.predict(at)
    there = followed.update([])
    np.testing.assert_array_equal(ahead.mean, there.mean)
    np.testing.assert_array_equal(ahead.cov, there.cov)
    assert ahead.poked == there.poked
    assert (ahead.time_s, ahead.marks_used, ahead.nis) == (at, 0, None)


def test_the_filter_stays_where_it_was(followed):
    """Mean, covariance and odds of the mixture and of each mode, bit by bit, and the next prediction."""
    before = [np.copy(a) for f in (followed.mixture, *followed.mixture.filters) for a in (f.x, f.P)]
    odds, time_s = followed.mixture.mu.copy(), followed.time_s
    followed.predict_at(time_s + AHEAD_S)
    after = [a for f in (followed.mixture, *followed.mixture.filters) for a in (f.x, f.P)]
    for was, now in zip(before, after, strict=True):
        np.testing.assert_array_equal(now, was)
    np.testing.assert_array_equal(followed.mixture.mu, odds)
    assert followed.time_s == time_s


def test_the_further_ahead_the_less_sure(followed):
    """Nothing is learnt in between, and pokes may come: the trace grows from 0 to 50, 100 and 200 ms."""
    traces = [np.trace(followed.predict_at(followed.time_s + t).cov) for t in (0.0, 0.05, 0.1, 0.2)]
    assert traces == sorted(traces)
    assert traces[-1] > 2.0 * traces[0]


def test_where_it_will_be_can_be_believed(phantom, rest_state, driven, poke_forces, marks_of):
    """0.1 s ahead, every second frame of three poked runs: 90 to 99 % of the truths lie in the 95 % region.

    Truth by DOP853 under half-sine pokes that the filter takes for Gauss-Markov noise.
    """
    ahead, squared = 3, []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        states = driven(phantom, rest_state, poke_forces(phantom, 5.0, rng))[::4]
        tissue = UnifiedFilter(phantom, HIDDEN, OUTER)
        for k, state in enumerate(states[:-ahead]):
            tissue.predict(k * FRAME_S)
            tissue.update(marks_of(phantom, state, 4.14e-3, rng))
            if k % 2:
                continue
            said = tissue.predict_at((k + ahead) * FRAME_S)
            off = said.mean - states[k + ahead][phantom.coordinates(HIDDEN)]
            squared.append(normalised_error_squared(off[None], said.cov[None])[0])
    assert 0.90 <= coverage(squared, 2) <= 0.99


@pytest.mark.parametrize("at", [-0.1, np.nan, np.inf])
def test_no_past_and_no_never(followed, at):
    with pytest.raises(ValueError, match="time_s: expected"):
        followed.predict_at(followed.time_s + at)


def test_no_future_before_the_first_frame(phantom):
    with pytest.raises(ValueError, match="time_s: expected None or later"):
        UnifiedFilter(phantom, HIDDEN, OUTER).predict_at(0.0)


def test_a_path_is_the_target_at_each_of_its_times(followed):
    """predict_path against predict_at of each, at multiples of the time between mixings: the same steps, 1e-12."""
    times = followed.time_s + np.arange(7) / 30
    means, covs = followed.predict_path(times)
    for k, time_s in enumerate(times):
        ahead = followed.predict_at(time_s)
        np.testing.assert_allclose(means[k], ahead.mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(covs[k], ahead.cov, rtol=1e-9, atol=1e-16)
    assert np.linalg.norm(means[-1] - means[0]) > 1e-4


def test_a_path_leaves_the_filter_where_it_was(followed):
    """The next prediction to the last bit, also after a fault on the way."""
    before, time_s = followed.predict_at(followed.time_s + AHEAD_S), followed.time_s
    followed.predict_path(time_s + np.arange(5) / 30)
    after = followed.predict_at(time_s + AHEAD_S)
    assert followed.time_s == time_s
    np.testing.assert_array_equal(after.mean, before.mean)
    np.testing.assert_array_equal(after.cov, before.cov)


@pytest.mark.parametrize("ahead", [[], [-0.1, 0.0], [0.0, np.nan], [0.0, np.inf], [0.0, 0.2, 0.1, 0.3]])
def test_a_path_goes_forward_and_ends(followed, ahead):
    with pytest.raises(ValueError, match="times_s: expected"):
        followed.predict_path(followed.time_s + np.array(ahead))


def test_the_modes_together_are_the_mixture(followed):
    """Mean and covariance of `predict_modes` against `predict_at`, 0.1 s ahead: 1 % of a standard deviation, 1 %.

    Were the tissue linear they would be the same: what is merged keeps its moments.
    """
    said, whole = (tell(followed.time_s + 0.1) for tell in (followed.predict_modes, followed.predict_at))
    mean, cov = moment_matched(said.weights, said.means, said.covs)
    sigma = np.sqrt(np.trace(whole.cov))
    np.testing.assert_allclose(mean, whole.mean, rtol=0, atol=0.01 * sigma)
    np.testing.assert_allclose(cov, whole.cov, rtol=0, atol=0.01 * sigma**2)
    assert np.ptp(np.trace(said.covs, axis1=1, axis2=2)) > 0.1 * np.trace(cov)


def test_a_poke_that_may_have_been_blurs_no_history_without_one(followed):
    """Between pokes now and on arrival: as a filter says to which only that mode is left, and nothing else can come.

    Its poked mode is a metre beside, at odds of a half. Odds by exp(rates t); 1e-12 of a metre, 1e-9.
    """
    mixture, at = followed.mixture, followed.time_s + 1 / 30
    mixture.mu = np.array([0.0, 0.5, 0.5, 0.0, 0.0, 0.0])
    mixture.filters[2].x = mixture.filters[2].x.copy()
    mixture.filters[2].x[followed.model.network.coordinates(HIDDEN)] += 1.0
    said = followed.predict_modes(at)
    never = replace(followed.settings, calm_s=1e12, between_s=1e12, unstruck_s=1e12)
    alone = UnifiedFilter(followed.model.network, HIDDEN, OUTER, never)
    alone.restore(followed.snapshot())
    alone.mixture.mu = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    alone.mixture.restart(mixture.filters[1].x, mixture.filters[1].P)
    expected = alone.predict_at(at)
    history = 6 + 1
    np.testing.assert_allclose(said.means[history], expected.mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(said.covs[history], expected.cov, rtol=1e-9, atol=1e-15)
    stays = expm(followed.settings.rates / 30)[1, 1]
    assert said.weights[history] == pytest.approx(0.5 * stays, rel=1e-6)


def test_times_rounded_to_the_nanosecond_take_as_many_steps(phantom, rest_state, marks_of):
    """A frame interval longer than 1/30 s by half a nanosecond: the same estimates, to a nanometre.

    Mixed and stepped once more they would move by some 10 µm.
    """
    told = []
    for dt in (1.0 / 30.0, 1.0 / 30.0 + 5e-10):
        rng = np.random.default_rng(2)
        tissue = UnifiedFilter(phantom, HIDDEN, OUTER)
        for k in range(20):
            tissue.predict(k * dt)
            said = tissue.update(marks_of(phantom, rest_state, 4.14e-3, rng))
        told.append(said)
    np.testing.assert_allclose(told[1].mean, told[0].mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(told[1].cov, told[0].cov, rtol=0, atol=1e-12)
