"""What the filter says of the target at a later moment, when a needle would arrive."""

from copy import deepcopy

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import UnifiedFilter, coverage, normalised_error_squared

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
