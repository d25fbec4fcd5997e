"""What the filter says of the target at a later moment, when a needle would arrive."""

from copy import deepcopy

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import TissueFilter, coverage, normalised_error_squared

FRAME_S = 4 / 120.0


@pytest.fixture(scope="module")
def after_two_seconds(phantom, rest_state, driven, poke_forces, marks_of):
    """A filter that followed a poked phantom for two seconds."""
    rng = np.random.default_rng(4)
    states = driven(phantom, rest_state, poke_forces(phantom, 2.0, rng))
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    for k, state in enumerate(states[::4]):
        tissue.predict(k * FRAME_S)
        tissue.update(marks_of(phantom, state, 1e-3, rng))
    return tissue


@pytest.fixture
def followed(after_two_seconds):
    """A copy of that filter."""
    return deepcopy(after_two_seconds)


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
        tissue = TissueFilter(phantom, HIDDEN, OUTER)
        for k, state in enumerate(states[:-ahead]):
            tissue.predict(k * FRAME_S)
            tissue.update(marks_of(phantom, state, 4.14e-3, rng))
            if k % 2:
                continue
            said = tissue.predict_at((k + ahead) * FRAME_S)
            off = said.mean - states[k + ahead][phantom.coordinates(HIDDEN)]
            squared.append(normalised_error_squared(off[None], said.cov[None])[0])
    assert 0.90 <= coverage(squared, 2) <= 0.99


@pytest.mark.parametrize("ahead", [[-0.1, 0.0], [0.0, np.nan], [0.0, np.inf], [0.0, 0.2, 0.1, 0.3]])
def test_a_path_goes_forward_and_ends(followed, ahead):
    with pytest.raises(ValueError, match="time_s: expected"):
        followed.predict_path(followed.time_s + np.array(ahead))


def test_times_rounded_to_the_nanosecond_take_as_many_steps(phantom, rest_state, marks_of):
    """A frame interval longer than 1/30 s by half a nanosecond: the same estimates, to a nanometre.

    Mixed and stepped once more they would move by some 10 µm.
    """
    told = []
    for dt in (1.0 / 30.0, 1.0 / 30.0 + 5e-10):
        rng = np.random.default_rng(2)
        tissue = TissueFilter(phantom, HIDDEN, OUTER)
        for k in range(20):
            tissue.predict(k * dt)
            said = tissue.update(marks_of(phantom, rest_state, 4.14e-3, rng))
        told.append(said)
    np.testing.assert_allclose(told[1].mean, told[0].mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(told[1].cov, told[0].cov, rtol=0, atol=1e-12)
