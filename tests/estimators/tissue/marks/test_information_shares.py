"""Information in an estimate: by which marks, how much against the open loop, by the model alone."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import OpenLoopCovariance, TissueFilter
from estimators.process.process_model import QUIET
from tests.estimators.conftest import followed, resting_frames


def test_gain_is_what_is_taken_off_the_open_loops_variance(phantom):
    """1 - trace by trace of an `OpenLoopCovariance` that got the same frames; 4 mm marks leave a few per cent of it."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    known = OpenLoopCovariance(phantom, HIDDEN, OUTER, QUIET.white)
    estimate = followed(tissue, resting_frames(phantom, 30, 4.14e-3))[-1]
    for k in range(30):
        known.take(1 / 30.0 if k else 0.0, dict.fromkeys(OUTER, 0.00414**2 * np.eye(2)))
    assert estimate.gain == pytest.approx(1.0 - np.trace(estimate.cov) / np.trace(known.target_cov), rel=1e-9)
    assert 0.7 < estimate.gain < 1.0


def test_the_model_alone_is_flagged(phantom):
    """Before marks, not while they come, and again once their information is old; also when they contain none."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    tissue.predict(0.0)
    assert tissue.update([]).model_only
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    assert not followed(tissue, resting_frames(phantom, 10, 4.14e-3))[-1].model_only
    unseen = followed(tissue, [((9 + k) / 30.0, []) for k in range(1, 45)])
    assert not unseen[0].model_only
    assert unseen[-1].model_only
    blind = TissueFilter(phantom, HIDDEN, OUTER)
    assert followed(blind, resting_frames(phantom, 5, 1.0))[-1].model_only
