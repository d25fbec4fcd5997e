"""The update by any marks of a frame, against the textbook's."""

import numpy as np
import pytest

MARK_SD = 4.14e-3
"""How well the paper's camera sees a mark, taken per axis [m]."""


def test_two_calls_for_one_time_are_one_call_with_both(phantom, rest_state, marks_of, warmed):
    """Marks with independent noise may come one after the other: Bayes' rule. Mixed moments after each: rounding."""
    rng = np.random.default_rng(1)
    marks = marks_of(phantom, rest_state, MARK_SD, rng)
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
