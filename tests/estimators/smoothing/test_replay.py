"""Frames and fixes in any order: as if they had come in theirs."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, FixBias, MarkMeasurement, Replay, TissueFilter

COV = 1e-6 * np.eye(2)


@pytest.fixture
def frames(phantom, rest_state, marks_of):
    """Twelve frames at 30 frames/s of the phantom at rest, seen with 1 mm of noise."""
    rng = np.random.default_rng(0)
    return [(k / 30.0, marks_of(phantom, rest_state, 1e-3, rng)) for k in range(12)]


def ordered(phantom, frames, settings=None):
    """A filter after the frames in their order, and its last estimate."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER, settings)
    for time_s, marks in frames:
        tissue.predict(time_s)
        last = tissue.update(marks)
    return tissue, last


@pytest.mark.parametrize("seed", range(4))
def test_shuffled_frames_give_what_ordered_ones_give(phantom, frames, seed):
    """To the last bit; the first frame comes first, the rest in any order within 0.5 s."""
    tissue, last = ordered(phantom, frames)
    replayed = Replay(TissueFilter(phantom, HIDDEN, OUTER), horizon_s=0.5)
    order = np.random.default_rng(seed).permutation(np.arange(1, 12))
    replayed.take(*frames[0])
    for k in order:
        estimate = replayed.take(*frames[k])
    np.testing.assert_array_equal(replayed.tissue.mixture.x, tissue.mixture.x)
    np.testing.assert_array_equal(replayed.tissue.mixture.P, tissue.mixture.P)
    np.testing.assert_array_equal(replayed.tissue.mixture.mu, tissue.mixture.mu)
    assert replayed.tissue.health == tissue.health
    np.testing.assert_array_equal(estimate.mean, last.mean)
    late = sum(1 for i, k in enumerate(order) if i and k < max(order[:i]))
    assert replayed.late == {"fused": late}


def test_an_estimate_is_of_the_newest_frame_whatever_came_last(phantom, frames):
    replayed = Replay(TissueFilter(phantom, HIDDEN, OUTER))
    for k in (0, 1, 3, 2):
        estimate = replayed.take(*frames[k])
    assert estimate.time_s == frames[3][0]
    assert replayed.tissue.time_s == frames[3][0]


def test_what_is_older_than_the_history_is_refused_and_counted(phantom, frames):
    """0.2 s: frame 5 is 6/30 s before the newest and fused, frame 4 is not."""
    replayed = Replay(TissueFilter(phantom, HIDDEN, OUTER), horizon_s=0.2)
    for k in (0, 1, 2, 11):
        replayed.take(*frames[k])
    before = replayed.tissue.mixture.x
    assert replayed.take(*frames[4]) is None
    np.testing.assert_array_equal(replayed.tissue.mixture.x, before)
    assert replayed.take(*frames[5]) is not None
    assert replayed.late == {"rejected": 1, "fused": 1}
    assert not np.array_equal(replayed.tissue.mixture.x, before)


def test_the_history_is_bounded(phantom, frames):
    replayed = Replay(TissueFilter(phantom, HIDDEN, OUTER), horizon_s=0.1)
    for frame in frames:
        replayed.take(*frame)
    assert len(replayed._kept) == 4  # 0, 1/30, 2/30 and 3/30 s old
    none = Replay(TissueFilter(phantom, HIDDEN, OUTER), horizon_s=0.0)
    for k in (0, 2, 1):
        none.take(*frames[k])
    assert none.late == {"rejected": 1}
    with pytest.raises(ValueError, match="horizon_s: expected 0 s or more"):
        Replay(TissueFilter(phantom, HIDDEN, OUTER), horizon_s=-1.0)


def test_a_late_frame_that_cannot_be_used_changes_nothing(phantom, frames):
    replayed = Replay(TissueFilter(phantom, HIDDEN, OUTER))
    for k in (0, 1, 3):
        replayed.take(*frames[k])
    before, kept = replayed.tissue.mixture.x, len(replayed._kept)
    with pytest.raises(ValueError, match="mark M9"):
        replayed.take(2 / 30.0, [MarkMeasurement("M9", np.zeros(2), COV)])
    np.testing.assert_array_equal(replayed.tissue.mixture.x, before)
    assert len(replayed._kept) == kept
    assert replayed.tissue.time_s == frames[3][0]
    assert not replayed.late


def test_a_late_fix_is_fused_at_its_own_time(phantom, frames, rest_state, hidden):
    """The same fix between frames 5 and 6, in order: to the last bit."""
    settings = replace(FilterSettings(), fix_bias=FixBias(1e-3))
    place = rest_state[hidden] + 1e-3
    tissue = TissueFilter(phantom, HIDDEN, OUTER, settings)
    for k, (time_s, marks) in enumerate(frames):
        if k == 6:
            tissue.predict(5.5 / 30.0)
            tissue.fix(place, COV)
        tissue.predict(time_s)
        tissue.update(marks)
    replayed = Replay(TissueFilter(phantom, HIDDEN, OUTER, settings))
    for frame in frames:
        replayed.take(*frame)
    replayed.fix(5.5 / 30.0, place, COV)
    np.testing.assert_array_equal(replayed.tissue.mixture.x, tissue.mixture.x)
    np.testing.assert_array_equal(replayed.tissue.mixture.P, tissue.mixture.P)


def alike(bias=None):
    """Settings whose modes are all the poked one: the mixture is a single filter."""
    usual = FilterSettings()
    return replace(usual, quiet=usual.poked, fix_bias=bias)


def test_a_fix_is_the_textbook_update_of_the_targets_rows(phantom, frames, hidden):
    """K = P H' (H P H' + R)^-1 with H the target's rows, 1e-10."""
    tissue, _ = ordered(phantom, frames, alike())
    x, P = tissue.mixture.x.copy(), tissue.mixture.P.copy()
    H = np.eye(len(x))[hidden]
    place = H @ x + [5e-4, -3e-4]
    tissue.fix(place, COV)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + COV)
    np.testing.assert_allclose(tissue.mixture.x, x + K @ (place - H @ x), rtol=0, atol=1e-10)
    np.testing.assert_allclose(tissue.mixture.P, P - K @ H @ P, rtol=0, atol=1e-10)


def test_what_fixes_are_off_by_together_is_not_taken_for_the_target(phantom, rest_state, marks_of, hidden):
    """Forty fixes, each 3 mm off to the right: told of a bias of 3 mm, the filter finds it and keeps the target.

    Not told, it follows the fixes by more than half of what they are off.
    """
    found = []
    for bias in (FixBias(3e-3), None):
        rng = np.random.default_rng(1)
        tissue = TissueFilter(phantom, HIDDEN, OUTER, replace(FilterSettings(), fix_bias=bias))
        for k in range(80):
            tissue.predict(k / 30.0)
            estimate = tissue.update(marks_of(phantom, rest_state, 2e-3, rng))
            if k % 2:
                estimate = tissue.fix(rest_state[hidden] + [3e-3, 0.0] + rng.normal(0.0, 2e-4, 2), 4e-8 * np.eye(2))
        found.append((estimate, tissue))
    (told, tissue), (not_told, _) = found
    assert abs(told.mean[0] - rest_state[hidden][0]) < 1e-3
    assert tissue.mixture.x[tissue.model.bias_rows][0] == pytest.approx(3e-3, abs=1e-3)
    assert not_told.mean[0] - rest_state[hidden][0] > 1.5e-3


def test_a_wild_fix_is_refused_once(phantom, frames, rest_state, hidden):
    tissue, before = ordered(phantom, frames)
    wild = rest_state[hidden] + [0.2, 0.0]
    np.testing.assert_array_equal(tissue.fix(wild, COV).mean, before.mean)
    assert tissue.rejected == {"fix": 1}
    assert tissue.fix(wild, COV).mean[0] > before.mean[0] + 0.01
    with pytest.raises(ValueError, match=r"fix: expected shapes \(2,\) and \(2, 2\)"):
        tissue.fix(np.zeros(3), COV)
    with pytest.raises(ValueError, match="expected predict"):
        TissueFilter(phantom, HIDDEN, OUTER).fix(wild, COV)
