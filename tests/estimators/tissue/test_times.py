"""Times of frames: long gaps, intervals that are rounded, and two calls for one time."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import Status, TissueFilter
from tests.estimators.conftest import followed, marks_of, resting_frames

MARK_SD = 4.14e-3
"""How well the paper's camera sees a mark, taken per axis [m]."""


@pytest.mark.parametrize("gap_s", [5.5, 1e300])
def test_after_a_gap_beyond_forget_s_the_filter_begins_again(phantom, rest_state, gap_s):
    """The tissue swings before: then LOST, where nothing but the prior is known; the next marks are all taken in."""
    tissue, aside = TissueFilter(phantom, HIDDEN, OUTER), np.eye(len(rest_state))[4]
    states = [rest_state + 0.03 * np.sin(0.3 * k) * aside for k in range(20)]
    followed(tissue, [(k / 30.0, marks_of(phantom, state)) for k, state in enumerate(states)])
    tissue.fix(rest_state[phantom.coordinates(HIDDEN)] + 1e-3, 1e-8 * np.eye(2))
    tissue.predict(tissue.time_s + gap_s)
    assert tissue.health.status is Status.LOST
    new = TissueFilter(phantom, HIDDEN, OUTER)
    for found, expected in zip(tissue.place_of(tissue.target), new.place_of(new.target), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    estimate = tissue.update(marks_of(phantom, rest_state))
    assert (estimate.status, estimate.marks_used) == (Status.INITIALISING, 3)
    assert tissue.repairs["restarted"] == 1


def test_times_rounded_to_the_nanosecond_take_as_many_steps(phantom):
    """A frame interval longer than 1/30 s by half a nanosecond: the same estimates, to a nanometre."""
    reported = []
    for dt in (1.0 / 30.0, 1.0 / 30.0 + 5e-10):
        frames = [(k * dt, marks) for k, (_, marks) in enumerate(resting_frames(phantom, 20, MARK_SD))]
        reported.append(followed(TissueFilter(phantom, HIDDEN, OUTER), frames)[-1])
    np.testing.assert_allclose(reported[1].mean, reported[0].mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(reported[1].cov, reported[0].cov, rtol=0, atol=1e-12)


def test_two_calls_for_one_time_are_one_call_with_both(phantom, rest_state, warmed):
    """Marks with independent noise may come one after the other: Bayes' rule. Mixed moments after each: rounding."""
    marks = marks_of(phantom, rest_state, MARK_SD, np.random.default_rng(1))
    ours, split = warmed(MARK_SD), warmed(MARK_SD)
    ours.predict(0.5)
    together = ours.update(marks)
    split.predict(0.5)
    split.update(marks[:1])
    split.predict(0.5)
    apart = split.update(marks[1:])
    np.testing.assert_allclose(apart.mean, together.mean, rtol=0, atol=1e-10)
    np.testing.assert_allclose(apart.cov, together.cov, rtol=0, atol=1e-12)
    assert apart.poked == pytest.approx(together.poked, abs=1e-10)
