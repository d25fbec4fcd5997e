"""Smoothing against filterpy's, and of the phantom against the filter alone."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FixedLag, TissueFilter, coverage, fixed_interval, normalised_error_squared
from estimators.core.discrepancy import Discrepancy
from estimators.core.filter import HypothesisFilter
from estimators.smoothing.smoother import Step, smooth, smoothed_before
from tests.estimators.conftest import followed, poked_frames
from tests.estimators.core.bodies import Point, Seen
from tests.estimators.core.test_filter import Saturating, textbook

NONE = np.array([], dtype=int)
VALUES = (0.3, 0.9, 1.1, 2.2)


def passed(kick=None):
    """Steps of a filter of one mode; what the textbook's is after each, and before its update."""
    found, known = HypothesisFilter(Point([0.3])), textbook(0.09)
    known.R = np.array([[0.04]])
    steps, expected, predicted = [], [], []
    for value in VALUES:
        found.trace = []
        found.predict(0.5, kick)
        known.predict()
        if kick is not None:
            known.x = known.x + kick[:, None]
        predicted.append(known.x.copy())
        found.update([Seen(value, 0.04)])
        known.update(value)
        steps.append(Step(*found.moments_by(found.weights), found.trace))
        expected.append((known.x.copy(), known.P.copy()))
    return steps, expected, predicted, known


@pytest.mark.parametrize("newest", range(1, len(VALUES) + 1))
def test_of_one_mode_each_state_is_that_of_filterpys_smoother_of_the_frames_until_then(newest):
    """The last state given is that with the longest lag; nothing is known of frames that have not come yet."""
    steps, expected, _, known = passed()
    xs, Ps = (np.array(each) for each in zip(*expected[:newest], strict=True))
    means, covs, *_ = known.rts_smoother(xs, Ps)
    found = list(smooth(reversed(steps[:newest]), NONE))[::-1]
    np.testing.assert_allclose([mean for mean, _ in found], means[..., 0], rtol=1e-8)
    np.testing.assert_allclose([cov for _, cov in found], covs, rtol=1e-8)


def test_of_one_mode_under_a_known_force_it_is_rauchs_smoother():
    steps, expected, predicted, known = passed(np.array([0.2, -0.1]))
    found = list(smooth(reversed(steps), NONE))
    x, P = expected[-1]
    for k, (mean, cov) in zip((2, 1, 0), found[1:], strict=True):
        ahead = known.F @ expected[k][1] @ known.F.T + known.Q
        gain = expected[k][1] @ known.F.T @ np.linalg.inv(ahead)
        x = expected[k][0] + gain @ (x - predicted[k + 1])
        P = expected[k][1] + gain @ (P - ahead) @ gain.T
        np.testing.assert_allclose(mean, x.ravel(), rtol=1e-8)
        np.testing.assert_allclose(cov, P, rtol=1e-8)


def test_a_state_that_is_considered_stays():
    """Later observations correct it no more than earlier ones."""
    found = HypothesisFilter(Point([0.3]), considered=[1])
    found.trace = []
    for value in (0.3, 0.9):
        found.predict(0.5)
        found.update([Seen(value, 0.04)])
    mean, cov = smoothed_before(*found.moments_by(found.weights), found.trace[1], np.array([1]))
    assert mean[1] == found.trace[1].mean_before[1]
    assert mean[0] != found.trace[1].mean_before[0]
    assert cov[1, 1] == found.trace[1].cov_before[1, 1]


def test_it_goes_back_by_the_motion_that_the_update_linearised_again():
    """To the place that the motion, an arctangent, takes to what was seen; linearised at the prior it would miss."""
    found = HypothesisFilter(Saturating([1e-3], bend=1.0))
    found.trace = []
    found.predict(0.5)
    found.update([Seen(0.5, 1e-4)])
    mean, _ = smoothed_before(*found.moments_by(found.weights), found.trace[0], NONE)
    assert mean[0] == pytest.approx(np.tan(0.5) / 6.0 - 0.7, abs=1e-3)


def new(phantom):
    """A filter that knows the phantom's constants to be exact."""
    return TissueFilter(phantom, HIDDEN, OUTER, discrepancy=Discrepancy(levels=(1e-3,)))


@pytest.fixture(scope="module")
def run():
    """A poked run of 2 s at 30 frames/s, 4.14 mm: frames and truth by DOP853."""
    return poked_frames(2.0, 0.00414, 1)


def test_later_marks_make_the_target_surer_and_it_is_right(phantom, run, hidden):
    """Mean error below 0.95 of the filter's, spread below 0.9 of it; 95 % regions hold 90 to 99 %."""
    frames, states = run
    filtered, smoothed = followed(new(phantom), frames), fixed_interval(new(phantom), frames)
    assert [e.time_s for e in smoothed] == [e.time_s for e in filtered]
    off = [np.array([e.mean for e in each]) - states[:, hidden] for each in (filtered, smoothed)]
    errors = [np.linalg.norm(o, axis=1).mean() for o in off]
    spreads = [np.sqrt([np.trace(e.cov) for e in each]).mean() for each in (filtered, smoothed)]
    np.testing.assert_allclose(smoothed[-1].mean, filtered[-1].mean, rtol=0, atol=1e-12)
    assert errors[1] < 0.95 * errors[0]
    assert spreads[1] < 0.9 * spreads[0]
    assert 0.9 < coverage(normalised_error_squared(off[1], [e.cov for e in smoothed]), 2) < 0.99


def test_a_fixed_lag_is_the_fixed_interval_cut_off_there(phantom, run):
    """Of each frame, 5/30 s later: the interval's smoothing that ends then; before, in and after a gap and a start."""
    frames = [(t, [] if 8 <= k < 40 else marks) for k, (t, marks) in enumerate(run[0][:48])]
    lag = FixedLag(new(phantom), lag_s=5 / 30.0 - 1e-9)
    found = [lag.take(*frame) for frame in frames]
    assert found[:5] == [None] * 5
    for end in (9, 47):
        whole = fixed_interval(new(phantom), frames[: end + 1])
        assert found[end].time_s == frames[end - 5][0]
        np.testing.assert_allclose(found[end].mean, whole[end - 5].mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(found[end].cov, whole[end - 5].cov, rtol=1e-9)
        assert found[end].status is whole[end - 5].status
    assert len(lag._passed) == 6


def test_marks_that_are_refused_change_nothing(phantom, run):
    """The frames after them are smoothed as if they had not come."""
    lags = [FixedLag(new(phantom), lag_s=0.1) for _ in range(2)]
    for k, frame in enumerate(run[0][:16]):
        if k == 10:
            with pytest.raises(ValueError, match="node"):
                lags[1].take(frame[0] - 0.01, [replace(frame[1][0], node=HIDDEN)])
        usual, found = (lag.take(*frame) for lag in lags)
        if usual is not None:
            np.testing.assert_array_equal(found.mean, usual.mean)
            np.testing.assert_array_equal(found.cov, usual.cov)


def test_no_lag_is_the_filter_and_a_lag_is_0_s_or_more(phantom, run):
    lag, frames = FixedLag(new(phantom), lag_s=0.0), run[0][:20]
    means = [lag.take(*frame).mean for frame in frames]
    np.testing.assert_allclose(means, [one.mean for one in followed(new(phantom), frames)], rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="lag_s: expected 0 s or more"):
        FixedLag(new(phantom), lag_s=-0.1)


def test_a_fix_tells_of_before_and_after(phantom, run, hidden):
    """Of the target to 0.1 mm, half way between frames 30 and 31: both become surer, and rightly."""
    frames, states = run[0][:34], run[1]
    place = states[30:32, hidden].mean(axis=0) + np.array([1e-4, -0.5e-4])
    time_s, cov = 30.5 / 30.0, 1e-8 * np.eye(2)
    without = fixed_interval(new(phantom), frames)
    found = fixed_interval(new(phantom), frames, fixes=[(time_s, place, cov)])
    assert [e.time_s for e in found] == [t for t, _ in frames]
    for k in (30, 31):
        assert np.trace(found[k].cov) < 0.5 * np.trace(without[k].cov)
        off = (found[k].mean - states[k, hidden])[None]
        assert normalised_error_squared(off, found[k].cov[None])[0] < 9.2  # 99 %
    tissue = new(phantom)
    followed(tissue, frames[:31])
    tissue.predict(time_s)
    tissue.fix(place, cov)
    last = followed(tissue, frames[31:])[-1]
    np.testing.assert_allclose(found[-1].mean, last.mean, rtol=0, atol=1e-12)
    beside = fixed_interval(new(phantom), frames, fixes=[(10.0, place, cov), (-1.0, place, cov)])
    np.testing.assert_array_equal([e.mean for e in beside], [e.mean for e in without])


def test_a_fix_at_the_time_of_the_first_frame_is_used(phantom, run, hidden):
    """Of the target to 0.1 mm, so it is known as well as that at this time."""
    frames, place = run[0][:5], run[1][0, hidden]
    found = fixed_interval(new(phantom), frames, fixes=[(frames[0][0], place, 1e-8 * np.eye(2))])
    assert len(found) == len(frames)
    np.testing.assert_allclose(found[0].mean, place, rtol=0, atol=3e-4)
    assert np.trace(found[0].cov) < 2e-8 * (1.0 + 1e-6)


def test_nothing_is_known_across_a_new_start(phantom, run):
    """Marks lost for 1.2 s, longer than lost_s, then a new start: what comes after changes no estimate of before."""
    frames = run[0]
    gap = [(t, marks if k < 4 or k >= 39 else []) for k, (t, marks) in enumerate(frames[:46])]
    whole = fixed_interval(new(phantom), gap)
    cut = fixed_interval(new(phantom), gap[:39])
    np.testing.assert_array_equal([e.mean for e in whole[:39]], [e.mean for e in cut])


def test_a_fix_at_the_time_of_a_frame_leaves_earlier_frames_as_smoothed(phantom, run):
    """A fix that is too coarse to tell anything, at the time of a frame and just before."""
    frames = run[0][:20]
    same, before = (
        fixed_interval(new(phantom), frames, fixes=[(frames[15][0] + shift, np.zeros(2), 1e6 * np.eye(2))])
        for shift in (0.0, -1e-6)
    )
    np.testing.assert_allclose([one.mean for one in same], [one.mean for one in before], atol=1e-6)
    np.testing.assert_allclose([one.cov for one in same], [one.cov for one in before], rtol=1e-3, atol=1e-12)
