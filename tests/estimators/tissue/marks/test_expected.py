"""Where marks are to be expected, and what the state becomes while none is seen."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, UnifiedFilter

MARK_SD = 4.14e-3
"""How well the paper's camera sees a mark, taken per axis [m]."""

ONE_MODE = FilterSettings(quiet=FilterSettings().poked, jolt=0.0)
"""All modes alike: a single unscented filter."""


def test_a_struck_mark_is_looked_for_as_far_as_a_blow_carries_it(phantom, rest_state, marks_of, warmed):
    """Cov of `expected` plus (1 m/s times the time since it was seen, 0.05 s at most)²; the scene's size before any."""
    fresh = UnifiedFilter(phantom, HIDDEN, OUTER)
    fresh.predict(0.0)
    reach = np.ptp(phantom.positions, axis=0).max()
    np.testing.assert_allclose(
        fresh.expected_after_impulse("M1")[1] - fresh.expected("M1")[1], reach**2 * np.eye(2), atol=1e-12
    )
    ours = warmed(MARK_SD)  # all marks last seen at 14/30 s
    ours.predict(14 / 30 + 0.02)
    ours.update(marks_of(phantom, rest_state, MARK_SD, np.random.default_rng(0), nodes=("M3",)))
    for t, off_m1, off_m3 in ((0.03, 0.03, 0.01), (0.06, 0.05, 0.04), (0.5, 0.05, 0.05)):
        ours.predict(14 / 30 + t)
        for node, off in (("M1", off_m1), ("M3", off_m3)):
            mean, cov = ours.expected_after_impulse(node)
            np.testing.assert_array_equal(mean, ours.expected(node)[0])
            np.testing.assert_allclose(cov - ours.expected(node)[1], off**2 * np.eye(2), rtol=0, atol=1e-12)


def test_where_the_target_may_be_seen_is_where_it_is(phantom, rest_state, marks_of, hidden, warmed):
    """With all modes alike the poked mode is the mixture: `expected` and the estimate agree. Rounding.

    With the modes of the filter they do not: `expected` is the poked mode's belief and the wider one for a mark.
    """
    single = UnifiedFilter(phantom, HIDDEN, OUTER, ONE_MODE)
    single.predict(0.0)
    single.update(marks_of(phantom, rest_state, MARK_SD, np.random.default_rng(0)))
    single.predict(0.1)
    mean, cov = single.expected(HIDDEN)
    estimate = single.update([])
    np.testing.assert_allclose(mean, estimate.mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(cov, estimate.cov, rtol=0, atol=1e-15)

    ours = warmed(MARK_SD)
    ours.predict(0.5)
    ours.mixture.mu = np.r_[ours.mixture.mu[:3], np.zeros(3)]  # no blows are about
    poked = ours.mixture.filters[2]
    mean, cov = ours.expected("M3")
    np.testing.assert_array_equal(mean, poked.x[4:6])
    np.testing.assert_array_equal(cov, poked.P[4:6, 4:6])
    assert np.linalg.eigvalsh(cov - ours.mixture.P[4:6, 4:6])[0] > 0


@pytest.mark.parametrize("frame", [1 / 60, 1 / 30, 1 / 10, 1 / 5, 1 / 50, 1 / 17])
def test_what_is_unseen_does_not_depend_on_the_frame_rate(phantom, frame, rest_state, marks_of):
    """One mode, 0.2 s or as near as frames come without marks: the covariance is that of frames of 1/120 s.

    All of them step by 1/120 s or a little less: rounding where frames are whole steps, 8 % of velocities
    (of means: 0.3 mm, mm/s) where steps are shorter, which is what a step of 1/120 s leaves out.
    """

    def unseen(dt, n):
        ours = UnifiedFilter(phantom, HIDDEN, OUTER, ONE_MODE)
        ours.predict(0.0)
        ours.update(marks_of(phantom, rest_state, 1e-3, np.random.default_rng(0)))
        for k in range(1, n + 1):
            ours.predict(k * dt)
        return ours.mixture.x, ours.mixture.P

    n = round(0.2 / frame)
    steps = int(np.ceil(120 * frame * n - 1e-9))
    whole = abs(120 * frame - round(120 * frame)) < 1e-9
    (x, P), (fine_x, fine_P) = unseen(frame, n), unseen(frame * n / steps, steps)
    scale = np.sqrt(np.outer(fine_P.diagonal(), fine_P.diagonal()))
    np.testing.assert_allclose(P / scale, fine_P / scale, rtol=0, atol=1e-9 if whole else 0.08)
    np.testing.assert_allclose(x, fine_x, rtol=0, atol=1e-9 if whole else 3e-4)
