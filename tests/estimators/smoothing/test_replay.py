"""Frames and fixes in any order: as if they had come in theirs."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, FixBias, MarkMeasurement, Replay, TissueFilter
from tests.estimators.states import digest

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
    assert digest(replayed.tissue.snapshot()) == digest(tissue.snapshot())
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
    before = digest(replayed.tissue.snapshot())
    assert replayed.take(*frames[4]) is None
    assert digest(replayed.tissue.snapshot()) == before
    assert replayed.take(*frames[5]) is not None
    assert replayed.late == {"rejected": 1, "fused": 1}
    assert digest(replayed.tissue.snapshot()) != before


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
    before, kept = digest(replayed.tissue.snapshot()), len(replayed._kept)
    with pytest.raises(ValueError, match="mark M9"):
        replayed.take(2 / 30.0, [MarkMeasurement("M9", np.zeros(2), COV)])
    assert digest(replayed.tissue.snapshot()) == before
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
    assert digest(replayed.tissue.snapshot()) == digest(tissue.snapshot())
