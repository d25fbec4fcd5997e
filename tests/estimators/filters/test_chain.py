"""A chain whose states share modes, against the forward algorithm of hidden Markov models with SciPy's exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from estimators.filters.chain import KEPT, LEAST, ModeChain

RATES = np.array([[-0.5, 0.5, 0.0], [0.2, -2.2, 2.0], [3.0, 1.0, -4.0]])
OF_STATE = (0, 0, 1)
ODDS = np.array([0.5, 0.3, 0.2])


def chain() -> ModeChain:
    """Two states of one mode, a third of another."""
    return ModeChain(ODDS, RATES, OF_STATE)


def test_odds_follow_the_forward_algorithm():
    """Predicted by exp(rates dt), weighed state by state with what its mode explains, normalised: 20 frames."""
    made, expected, rng = chain(), ODDS.copy(), np.random.default_rng(0)
    for _ in range(20):
        dt, likelihoods = rng.uniform(0.01, 1.0), rng.uniform(0.1, 2.0, 2)
        expected = expected @ expm(RATES * dt)
        states, modes, _ = made.ahead(dt)
        np.testing.assert_allclose(states, expected, rtol=1e-12)
        np.testing.assert_allclose(modes, [expected[:2].sum(), expected[2]], rtol=1e-12)
        made.odds = states
        assert made.weigh(likelihoods) == pytest.approx(expected @ likelihoods[list(OF_STATE)], rel=1e-12)
        expected = expected * likelihoods[list(OF_STATE)]
        expected /= expected.sum()
        np.testing.assert_allclose(made.odds, expected, rtol=1e-12)
        np.testing.assert_allclose(made.mode_odds, [expected[:2].sum(), expected[2]], rtol=1e-12)


def test_weights_are_where_those_in_a_mode_come_from():
    """P(mode i now | mode j then) = sum over states of P(i, j) / P(j), by Bayes."""
    joint = ODDS[:, None] * expm(RATES * 0.3)
    by_mode = np.array([[joint[:2, :2].sum(), joint[:2, 2].sum()], [joint[2, :2].sum(), joint[2, 2]]])
    _, modes, found = chain().ahead(0.3)
    np.testing.assert_allclose(found, by_mode / by_mode.sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(modes, by_mode.sum(axis=0), rtol=1e-12)


def test_without_a_table_each_state_is_a_mode():
    made = ModeChain(ODDS, RATES)
    assert made.n_modes == 3
    np.testing.assert_array_equal(made.mode_odds, ODDS)


def test_odds_that_are_set_keep_states_of_a_mode_as_they_were_to_each_other():
    """Of a mode that nothing was known of, alike."""
    made = chain()
    made.set_mode_odds(np.array([0.4, 0.6]))
    np.testing.assert_allclose(made.odds, [0.25, 0.15, 0.6], rtol=1e-14)
    made.set_mode_odds(np.array([0.0, 1.0]))
    made.set_mode_odds(np.array([0.5, 0.5]))
    np.testing.assert_allclose(made.odds, [0.25, 0.25, 0.5], rtol=1e-14)


def test_no_state_is_ruled_out_for_good():
    """Likelihoods that differ by 1e300: the least odds stay above nothing, and sum to one."""
    made = chain()
    made.weigh(np.array([1e-300, 1.0]))
    assert made.odds.min() >= 0.5 * LEAST
    assert made.odds.sum() == pytest.approx(1.0, abs=1e-15)
    assert made.ahead(0.1)[0].min() > 0.0


def test_a_mode_that_nothing_leads_to_goes_on_from_what_it_is():
    """Weights are those of a mean whatever the odds: each column sums to one."""
    alone = ModeChain(np.array([1.0, 0.0]), np.zeros((2, 2)))
    np.testing.assert_array_equal(alone.ahead(0.1)[2], np.eye(2))


def test_transitions_of_ever_new_times_need_no_ever_more_memory():
    made = chain()
    for k in range(3 * KEPT):
        made.ahead(0.01 + 1e-4 * k)
    assert len(made._transitions) <= KEPT
    np.testing.assert_allclose(made.ahead(0.02)[0], ODDS @ expm(0.02 * RATES), rtol=1e-12)


def test_forces_that_begin_have_their_full_variance_at_once():
    """Two modes by definition: who enters the strong mode gets what is missing, others nothing."""
    rates = np.array([[-2.0, 2.0], [3.0, -3.0]])
    chain = ModeChain([0.9, 0.1], rates)
    _, _, weights = chain.ahead(0.1)
    found = chain.begun(weights, np.array([[1.0, 0.0], [5.0, 2.0]]))
    M = expm(0.1 * rates)
    entering = 0.9 * M[0, 1] / (0.9 * M[0, 1] + 0.1 * M[1, 1])
    wanted = [[0.0, 0.0], [4.0 * entering, 2.0 * entering]]
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
