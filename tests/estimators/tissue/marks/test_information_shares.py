"""What carries an estimate: which marks, how much against the open loop, whether the model alone; wrong constants."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import OpenLoopCovariance, TissueFilter
from estimators.process.process_model import QUIET


def followed(tissue, network, state, marks_of, frames=30, sd=0.00414, seed=0):
    rng = np.random.default_rng(seed)
    for k in range(frames):
        tissue.predict(k / 30.0)
        last = tissue.update(marks_of(network, state, sd, rng))
    return last


def test_gain_is_what_is_taken_off_the_open_loops_variance(phantom, rest_state, marks_of):
    """1 - trace by trace of an `OpenLoopCovariance` that got the same frames; 4 mm marks leave a few per cent of it."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    known = OpenLoopCovariance(phantom, HIDDEN, OUTER, QUIET.white)
    estimate = followed(tissue, phantom, rest_state, marks_of, frames=60)
    for k in range(60):
        known.take(1 / 30.0 if k else 0.0, dict.fromkeys(OUTER, 0.00414**2 * np.eye(2)))
    assert estimate.gain == pytest.approx(1.0 - np.trace(estimate.cov) / np.trace(known.target_cov), rel=1e-9)
    assert 0.7 < estimate.gain < 1.0


def test_the_model_alone_is_flagged(phantom, rest_state, marks_of):
    """Before marks, not while they come, and again once what they told has worn off; also when they tell nothing."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    tissue.predict(0.0)
    assert tissue.update([]).model_only
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    assert not followed(tissue, phantom, rest_state, marks_of).model_only
    flags = []
    for k in range(1, 90):
        tissue.predict(29 / 30.0 + k / 30.0)
        flags.append(tissue.update([]).model_only)
    assert not flags[0]
    assert flags[-1]
    blind = TissueFilter(phantom, HIDDEN, OUTER)
    assert followed(blind, phantom, rest_state, marks_of, sd=1.0, frames=5).model_only
