"""The search from several starts, on posteriors of known maximum."""

import numpy as np
import pytest

from estimators import MarkMeasurement
from estimators.identification.budget import Budget, OutOfTimeError
from estimators.identification.filter_pass import Pass, failed_pass
from estimators.identification.search import followed, from_starts, gauss_newton, starts
from estimators.identification.stretch import affordable, frame_seconds, liveliest
from tests.estimators.identification.passes import pass_of

T = np.random.default_rng(0).normal(size=(50, 3))
Z = T @ np.array([1.0, -2.0, 0.5]) + np.random.default_rng(1).normal(size=50)
ONE = np.ones(3)


def linear(theta):
    """50 numbers z = T theta + noise of variance 1, in two frames: too few to repeat each other."""
    y = Z - T @ theta
    scores = (T * y[:, None]).reshape(2, 25, 3).sum(axis=1)
    return Pass(scores, T.T @ T, -0.5 * float(y @ y), y**2, np.ones(50), np.zeros((3, 3)))


def bent(theta):
    """One number, 0.2 away from theta^2, that is seen 100 times: maxima at both roots of what was seen."""
    return pass_of(np.full(100, 4.2 - float(theta[0]) ** 2), 2.0 * float(theta[0]))


def test_a_linear_posterior_is_found_exactly():
    """(T' T + 1)^-1 T' z, in two passes: Gauss-Newton's step is exact."""
    found = gauss_newton(linear, np.zeros(3), 0.1 * ONE)
    np.testing.assert_allclose(found.theta, np.linalg.solve(T.T @ T + np.eye(3), T.T @ Z), rtol=1e-9)
    assert found.converged
    assert found.passes == 2


def test_starts_begin_with_the_constants_given_and_spread_over_the_prior():
    points = starts(np.array([1.0, 3.0]), 33)
    np.testing.assert_array_equal(points[0], 0.0)
    assert (np.abs(points) <= [1.0, 3.0]).all()
    assert (points[1:].min(axis=0) < [-0.9, -2.7]).all()
    assert (points[1:].max(axis=0) > [0.9, 2.7]).all()
    np.testing.assert_array_equal(points[:3], starts(np.array([1.0, 3.0]), 3))
    assert starts(ONE, 1).shape == (1, 3)


def test_starts_that_find_another_maximum_do_not_agree():
    found = from_starts(followed(bent, np.array([x]), np.array([0.1])) for x in (1.0, 3.0, -1.0))
    np.testing.assert_allclose([one.theta[0] for one in found], np.sqrt(4.2) * np.array([1, 1, -1]), rtol=0.01)
    assert [found[0].agrees(one) for one in found] == [True, True, False]


def test_a_step_that_fails_is_halved():
    """No finite state beyond 1.5: the maximum at 1 is found from 0, where the full step goes to 3."""

    def at(theta):
        if theta[0] > 1.5:
            return failed_pass(1)
        slope = 0.3 if theta[0] < 0.5 else 1.0
        return pass_of(np.full(100, slope * (1.0 - theta[0])), slope, share=1.0 / 3.0)

    found = gauss_newton(at, np.zeros(1), np.array([0.1]))
    assert found.theta[0] == pytest.approx(1.0, abs=0.05)


def test_out_of_time_what_was_found_until_then_is_returned():
    passes = []

    def at(theta):
        passes.append(theta)
        if len(passes) > 3:
            raise OutOfTimeError
        return bent(theta)

    found = from_starts(followed(at, np.array([x]), np.array([0.1])) for x in (1.0, 3.0))
    assert len(found) == 1
    assert not found[0].in_time
    assert found[0].log_posterior > bent(np.array([1.0])).log_likelihood
    with pytest.raises(OutOfTimeError):
        from_starts([followed(at, np.array([1.0]), np.array([0.1]))])


def test_a_budget_ends_and_a_part_of_it_earlier():
    now = [0.0]
    budget = Budget(10.0, lambda: now[0])
    part = budget.part(0.5)
    now[0] = 6.0
    budget.check()
    assert budget.share == pytest.approx(0.6)
    with pytest.raises(OutOfTimeError):
        part.check()
    with pytest.raises(ValueError, match="seconds: expected more than 0, found 0"):
        Budget(0.0)


def test_the_liveliest_frames_are_kept_where_the_time_does_not_do():
    """100 frames that move between 60 and 80: 20 of them, at 0.1 s a frame and 5 passes 10 s allow for."""
    places = np.cumsum(np.where((np.arange(100) >= 60) & (np.arange(100) < 80), 1e-2, 1e-5))
    frames = [(0.1 * k, [MarkMeasurement("a", np.array([x, 0.0]), np.eye(2))]) for k, x in enumerate(places)]
    budget = Budget(10.0, lambda: 0.0)
    kept = affordable(frames, 0.1, 5, budget)
    assert len(kept) == 20
    assert kept[0][0] == pytest.approx(6.0, abs=0.11)
    assert len(liveliest(frames, 0)) == 0
    assert liveliest(frames, 200) is frames
    assert affordable(frames, 0.0, 5, budget) is frames
    with pytest.raises(OutOfTimeError):
        affordable(frames, 0.1, 50, budget)


def test_a_pause_does_not_count_as_the_time_of_a_pass():
    """A frame takes 0.1 s; compiled code is loaded for 5 s in the first pass, and 2 s are lost in the second."""
    clock, lost = [0.0], iter([5.0, 2.0])
    frames = [(float(k), []) for k in range(10)]

    def run(some):
        clock[0] += 0.1 * len(some) + next(lost, 0.0)

    taken = frame_seconds(run, frames, Budget(60.0, lambda: clock[0]))
    assert taken == pytest.approx(0.1)
