"""What carries an estimate: which marks, how much against the open loop, whether the model alone; wrong constants."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, independent_uncertainty, parameters, scale_parameters
from estimators import OpenLoopCovariance, UnifiedFilter, coverage


def followed(tissue, network, state, marks_of, frames=30, sd=0.00414, seed=0):
    rng = np.random.default_rng(seed)
    for k in range(frames):
        tissue.predict(k / 30.0)
        last = tissue.update(marks_of(network, state, sd, rng))
    return last


def test_gain_is_what_is_taken_off_the_open_loops_variance(phantom, rest_state, marks_of):
    """1 - trace by trace of an `OpenLoopCovariance` that got the same frames; 4 mm marks leave a few per cent of it."""
    tissue = UnifiedFilter(phantom, HIDDEN, OUTER)
    known = OpenLoopCovariance(phantom, HIDDEN, OUTER, QUIET.white)
    estimate = followed(tissue, phantom, rest_state, marks_of, frames=60)
    for k in range(60):
        known.take(1 / 30.0 if k else 0.0, dict.fromkeys(OUTER, 0.00414**2 * np.eye(2)))
    assert estimate.gain == pytest.approx(1.0 - np.trace(estimate.cov) / np.trace(known.target_cov), rel=1e-9)
    assert 0.8 < estimate.gain < 1.0


def test_the_model_alone_is_flagged(phantom, rest_state, marks_of):
    """Before marks, not while they come, and again once what they told has worn off; also when they tell nothing."""
    tissue = UnifiedFilter(phantom, HIDDEN, OUTER)
    tissue.predict(0.0)
    assert tissue.update([]).model_only
    tissue = UnifiedFilter(phantom, HIDDEN, OUTER)
    assert not followed(tissue, phantom, rest_state, marks_of).model_only
    flags = []
    for k in range(1, 90):
        tissue.predict(29 / 30.0 + k / 30.0)
        flags.append(tissue.update([]).model_only)
    assert not flags[0]
    assert flags[-1]
    blind = UnifiedFilter(phantom, HIDDEN, OUTER)
    assert followed(blind, phantom, rest_state, marks_of, sd=1.0, frames=5).model_only


@pytest.fixture(scope="module")
def wrong_runs(phantom, rest_state, driven, poke_forces, marks_of):
    """Four runs of 2.5 s whose model has springs 15 % off: the model, frames of marks of 1 mm, where the target was."""
    which = parameters(phantom, ("stiffness",))
    runs = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        states = driven(phantom, rest_state, poke_forces(phantom, 2.5, rng))[::4]
        frames = [(k / 30.0, marks_of(phantom, s, 0.001, rng)) for k, s in enumerate(states)]
        runs.append((scale_parameters(phantom, which, 0.15 * rng.normal(size=10)), frames, states[:, 2:4]))
    return independent_uncertainty(which, 0.15), runs


def covered(wrong_runs, uncertainty):
    nees = []
    for network, frames, truth in wrong_runs[1]:
        tissue = UnifiedFilter(network, HIDDEN, OUTER, uncertainty=uncertainty)
        for (time_s, marks), place in zip(frames, truth, strict=True):
            tissue.predict(time_s)
            estimate = tissue.update(marks)
            off = estimate.mean - place
            nees.append(off @ np.linalg.solve(estimate.cov, off))
    return coverage(nees, 2)


def test_the_covariance_knows_of_constants_that_are_off(wrong_runs):
    """95 % regions hold 88 to 100 % where it is told so, and below 80 % where it is not. Truth by DOP853."""
    assert covered(wrong_runs, wrong_runs[0]) > 0.88
    assert covered(wrong_runs, None) < 0.8
