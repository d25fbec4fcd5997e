"""Frames and fixes in any order: as if they had come in theirs."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, FixBias, MarkMeasurement, Replay, TissueFilter
from tests.estimators.conftest import followed, resting_frames
from tests.estimators.states import digest

COV = 1e-6 * np.eye(2)


@pytest.fixture
def frames(phantom):
    """Twelve frames at 30 frames/s of the phantom at rest, seen with 1 mm of noise."""
    return resting_frames(phantom, 12, 1e-3)


def replay(phantom, frames, order, settings=None, **options):
    """A replay that took these frames in this order, and its last estimate."""
    replayed = Replay(TissueFilter(phantom, HIDDEN, OUTER, settings), **options)
    return replayed, [replayed.take(*frames[k]) for k in order][-1]


@pytest.mark.parametrize("seed", range(2))
def test_shuffled_frames_give_what_ordered_ones_give(phantom, frames, seed):
    """To the last bit; the first frame comes first, the rest in any order within 0.5 s."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    last = followed(tissue, frames)[-1]
    order = np.random.default_rng(seed).permutation(np.arange(1, 12))
    replayed, estimate = replay(phantom, frames, [0, *order], horizon_s=0.5)
    assert digest(replayed.tissue.snapshot()) == digest(tissue.snapshot())
    np.testing.assert_array_equal(estimate.mean, last.mean)
    late = sum(1 for i, k in enumerate(order) if i and k < max(order[:i]))
    assert replayed.late == {"fused": late}


def test_what_is_older_than_the_history_is_refused_and_counted(phantom, frames):
    """0.2 s: frame 5 is 6/30 s before the newest and fused, frame 4 is not."""
    replayed, _ = replay(phantom, frames, (0, 1, 2, 11), horizon_s=0.2)
    before = digest(replayed.tissue.snapshot())
    assert replayed.take(*frames[4]) is None
    assert digest(replayed.tissue.snapshot()) == before
    assert replayed.take(*frames[5]) is not None
    assert replayed.late == {"rejected": 1, "fused": 1}
    assert digest(replayed.tissue.snapshot()) != before


@pytest.mark.parametrize("first", [None, 0.7])
def test_of_a_filter_that_has_run_nothing_older_is_taken(phantom, frames, first):
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    followed(tissue, [(k / 30.0, frames[0][1]) for k in range(20)])
    replayed = Replay(tissue)
    if first is not None:
        replayed.take(first, frames[0][1])
    assert replayed.take(0.6, frames[0][1]) is None
    assert replayed.late == {"rejected": 1}


def test_the_history_is_bounded(phantom, frames):
    replayed, _ = replay(phantom, frames, range(12), horizon_s=0.1)
    assert len(replayed._kept) == 4  # 0, 1/30, 2/30 and 3/30 s old
    none, _ = replay(phantom, frames, (0, 2, 1), horizon_s=0.0)
    assert none.late == {"rejected": 1}
    with pytest.raises(ValueError, match="horizon_s: expected 0 s or more"):
        Replay(TissueFilter(phantom, HIDDEN, OUTER), horizon_s=-1.0)


def test_a_late_frame_that_cannot_be_used_changes_nothing(phantom, frames):
    replayed, _ = replay(phantom, frames, (0, 1, 3))
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
    followed(tissue, frames[:6])
    tissue.predict(5.5 / 30.0)
    tissue.fix(place, COV)
    followed(tissue, frames[6:])
    replayed, _ = replay(phantom, frames, range(12), settings)
    replayed.fix(5.5 / 30.0, place, COV)
    assert digest(replayed.tissue.snapshot()) == digest(tissue.snapshot())
