"""The filter ahead in time: tables against its own predictions, and known forces against simulations."""

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import HIDDEN, OUTER, breast_phantom
from estimators import TissueFilter
from estimators.core.disturbances import Disturbances
from tests.estimators.conftest import driven, followed, marks_of, resting_frames

CYCLE_S = 1.0 / 30.0


def settled(network, target, marked, by_m=0.002):
    """A filter after a second of marks that rest a little aside, seen to half a millimetre."""
    unified = TissueFilter(network, target, marked)
    followed(unified, resting_frames(network, 30, 5e-4, marked, by_m))
    return unified


@pytest.fixture(params=["phantom", "breast"], scope="module")
def near_rest(request, phantom):
    if request.param == "phantom":
        return settled(phantom, HIDDEN, OUTER)
    made = breast_phantom()
    return settled(made.network, made.target, made.outer, by_m=5e-4)


def test_tables_are_the_predictions_near_rest(near_rest):
    """Mean to 2 % of where the body is aside or a tenth of sigma, covariance to 12 %, over half a second."""
    tables = near_rest.tables(16, CYCLE_S)
    times, (_, means, covs) = tables.times(near_rest), tables.parts(near_rest)[-1]
    path, path_covs = near_rest.predict_path(times)
    sigma = np.sqrt(np.trace(path_covs, axis1=1, axis2=2))
    assert np.all(np.linalg.norm(means - path, axis=1) < 0.02 * 2e-3 + 0.1 * sigma)
    apart = np.linalg.norm(covs - path_covs, axis=(1, 2)) / np.linalg.norm(path_covs, axis=(1, 2))
    assert apart.max() < 0.12


def test_the_probabilities_of_nested_cases_are_those_of_the_chain(near_rest):
    """Truth: the chain leaves calm for poked or led, each slow force for stronger ones, at the rates of the prior."""
    tables = near_rest.tables(16, CYCLE_S)
    often = near_rest.filter.rates[0, 1] / near_rest.process.rates[0, 1]
    assert 0.5 < often < 1.0
    d = near_rest.process.disturbances
    (weights, means, covs), (unled, *_), (every, _, whole) = tables.parts(near_rest)
    now = near_rest.filter.weights[d.calm_modes]
    rates = np.tril(np.full((3, 3), 1.0 / d.fall_s), -1)
    leaving = np.array([2.0, 1.0, 0.0]) / d.rise_s + 1.0 / d.calm_s + 1.0 / d.led_each_s
    rates -= np.diag(rates.sum(axis=1) + often * leaving)
    truth = [(now @ expm(rates * CYCLE_S * k)).sum() for k in range(16)]
    np.testing.assert_allclose(weights, truth, rtol=2e-2)
    assert np.all(np.diff(weights) < 0.0)
    now = near_rest.filter.weights.reshape(3, 3)[:, :2].sum()
    np.testing.assert_allclose(unled, now * np.exp(-CYCLE_S * np.arange(16) * often / d.led_each_s), rtol=1e-3)
    np.testing.assert_allclose(every, 1.0, rtol=1e-9)
    assert np.all(np.trace(covs, axis1=1, axis2=2) <= np.trace(whole, axis1=1, axis2=2) * (1.0 + 1e-9))
    assert means.shape == (16, len(near_rest.rest[0]))


def test_a_push_moves_the_tables_as_a_prediction_under_it(near_rest):
    """Held for half a second, enough for some millimetres."""
    tables = near_rest.tables(16, CYCLE_S)
    network = near_rest.network
    push = 0.3 * network.masses[network.free, None] * np.ones(network.dim)
    moved = tables.shift(np.tile(push, (15, 1, 1)))
    then_s = near_rest.time_s + 15 * CYCLE_S
    truth = near_rest.predict_at(then_s, push).mean - near_rest.predict_at(then_s).mean
    assert np.linalg.norm(moved[-1] - truth) < 0.12 * np.linalg.norm(truth)
    with pytest.raises(ValueError, match=r"push: expected shape \(15, n_free, dim\), found"):
        tables.shift(np.zeros((3, 1, 1)))


def test_tables_need_a_first_frame(phantom):
    unified = TissueFilter(phantom, HIDDEN, OUTER)
    with pytest.raises(ValueError, match="expected a filter after its first frame"):
        unified.tables(3, CYCLE_S).times(unified)


QUIET = Disturbances(calm_m_s2=1e-4, poke_m_s2=1e-4, led_m_s2=1e-4, slow_m_s2=(1e-4,), bent=0.0)


def constant(_t):
    return 1.0


def swinging(t):
    return float(np.sin(2.0 * np.pi * t))


@pytest.mark.parametrize(("share", "frame_s"), [(constant, 1.0 / 30.0), (swinging, 0.2)])
def test_a_known_force_moves_the_body_as_a_simulation_under_it(phantom, rest_state, share, frame_s):
    """2 m/s² on one marked mass for 1 s; truth by DOP853; a function of time, or a force held over each prediction."""
    force = np.zeros((4, 2))
    force[0] = phantom.masses[0] * np.array([2.0, 1.0])
    n = 120
    truth = driven(phantom, rest_state, [force * share((k + 0.5) / 120.0) for k in range(n)])[-1]
    unified = TissueFilter(phantom, HIDDEN, [*OUTER, HIDDEN], disturbances=QUIET)
    unified.predict(0.0)
    unified.update(marks_of(phantom, rest_state, nodes=[*OUTER, HIDDEN]))
    start = unified.positions[phantom.free]
    np.testing.assert_allclose(start, phantom.positions[phantom.free], atol=1e-9)
    push = force if share is constant else lambda t, _states: force * share(t)
    for k in range(1, round(1.0 / frame_s) + 1):
        unified.predict(k * frame_s, push)
    moved = unified.positions[phantom.free].ravel() - rest_state[:8]
    true = truth[:8] - rest_state[:8]
    assert np.linalg.norm(true) > 3e-3
    assert np.linalg.norm(moved - true) < 0.05 * np.linalg.norm(true)
