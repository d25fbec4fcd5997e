"""The table of methods: each name makes its own class, which runs as itself; an unknown name raises."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom
from estimators import (
    METHODS,
    EnsembleKalmanFilter,
    ExtendedKalmanFilter,
    FilterSettings,
    FixedIntervalSmoother,
    MarkMeasurement,
    ParticleFilter,
    StockUnscented,
    TrackingProblem,
    UnknownMethodError,
    fixed_interval,
    make_method,
)
from estimators.core.track import TissueFilter

CLASSES = {
    "ekf": ExtendedKalmanFilter,
    "filterpy-ukf": StockUnscented,
    "enkf": EnsembleKalmanFilter,
    "particles": ParticleFilter,
    "smoother": FixedIntervalSmoother,
}


@pytest.fixture(scope="module")
def problem():
    return TrackingProblem(four_mass_phantom(), HIDDEN, OUTER, FilterSettings())


@pytest.fixture(scope="module")
def frames():
    """Eight frames at 30 frames/s: M3 is pushed aside by 5 mm a frame, all marks err by 1 mm an axis."""
    network, rng = four_mass_phantom(), np.random.default_rng(4)
    shown = []
    for k in range(8):
        at = {node: network.positions[network.index(node)] + rng.normal(0.0, 1e-3, 2) for node in OUTER}
        at["M3"] = at["M3"] + [5e-3 * k, 0.0]
        shown.append((k / 30.0, [MarkMeasurement(node, x, 1e-6 * np.eye(2)) for node, x in at.items()]))
    return shown


def test_each_name_makes_its_own_class(problem):
    assert {name: type(make_method(name, problem)) for name in METHODS} == CLASSES


def test_each_method_gives_estimates_of_its_own(problem, frames):
    """One estimate a frame, at its time; after the pushes no two methods agree to a nanometre."""
    last = []
    for name in METHODS:
        found = [one for block in make_method(name, problem).run(frames) for one in block]
        assert [one.time_s for one in found] == [time_s for time_s, _ in frames]
        # the last frame of a smoother is the filter's, and that of the particle filter nearly
        last.append(found[5].mean)
    apart = np.linalg.norm(np.array(last)[:, None] - np.array(last), axis=2)
    assert apart[np.triu_indices(len(last), 1)].min() > 1e-9


def test_a_baseline_runs_as_predict_and_update(problem, frames):
    """A block a frame, equal to the bit."""
    blocks = list(make_method("ekf", problem).run(frames))
    assert [len(block) for block in blocks] == [1] * len(frames)
    method = ExtendedKalmanFilter(*problem.physics)
    for (time_s, marks), (found,) in zip(frames, blocks, strict=True):
        method.predict(time_s)
        expected = method.update(marks)
        np.testing.assert_array_equal(found.mean, expected.mean)
        np.testing.assert_array_equal(found.cov, expected.cov)


def test_the_smoother_gives_all_frames_at_the_end(problem, frames):
    (block,) = make_method("smoother", problem).run(frames)
    expected = fixed_interval(TissueFilter(*problem.physics), frames)
    np.testing.assert_array_equal([one.mean for one in block], [one.mean for one in expected])


def test_random_methods_start_at_the_seed_of_the_problem(problem, frames):
    runs = [[block[0].mean for block in make_method("enkf", problem).run(frames)] for _ in range(2)]
    np.testing.assert_array_equal(*runs)


def test_an_unknown_name_raises_with_the_names_there_are(problem):
    with pytest.raises(
        UnknownMethodError, match='expected one of ekf, filterpy-ukf, enkf, particles, smoother, found "oracle"'
    ):
        make_method("oracle", problem)
