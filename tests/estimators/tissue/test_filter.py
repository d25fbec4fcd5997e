"""The filter of the tissue: how far off, how sure of itself, and what it does when marks are missing."""

from dataclasses import dataclass

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, rest_shape
from estimators import OpenLoop, TissueFilter, coverage, normalised_error_squared
from tests.estimators.conftest import driven, followed, marks_of, poke_forces
from tests.networks import build_network

MARK_SD = 4.14e-3
"""How well the paper's camera sees a mark, taken per axis [m]."""

EVERY = 4
"""Steps of 1/120 s to a frame: 30 frames/s."""


@dataclass(frozen=True)
class Followed:
    """Errors of the hidden mass frame by frame [m], (n, 2), and what the filter said of them."""

    errors: np.ndarray
    open_loop: np.ndarray
    covs: np.ndarray


def follow(phantom, rest_state, seed, poked, seconds, seen=1.0):
    """So long at 30 frames/s from rest; each mark is seen with probability `seen`."""
    rng, hidden = np.random.default_rng(seed), phantom.coordinates(HIDDEN)
    states = driven(phantom, rest_state, poke_forces(phantom, seconds, rng, poked=poked))[::EVERY]
    frames = []
    for k, state in enumerate(states):
        frames.append((k / 30.0, [mark for mark in marks_of(phantom, state, MARK_SD, rng) if rng.random() < seen]))
    loop = OpenLoop(phantom, HIDDEN)
    estimates = followed(TissueFilter(phantom, HIDDEN, OUTER), frames)
    assert [one.marks_used for one in estimates] == [len(marks) for _, marks in frames]
    return Followed(
        errors=np.array([e.mean for e in estimates]) - states[:, hidden],
        open_loop=np.array([loop.update(*frame).mean for frame in frames]) - states[:, hidden],
        covs=np.array([e.cov for e in estimates]),
    )


@pytest.fixture(scope="module")
def runs(phantom, rest_state):
    """A quiet run and a poked one."""
    return {"quiet": follow(phantom, rest_state, 0, False, 4.0), "poked": follow(phantom, rest_state, 0, True, 10.0)}


def size(errors):
    return np.linalg.norm(errors, axis=1)


@pytest.mark.parametrize(("kind", "share"), [("quiet", 0.15), ("poked", 0.3)])
def test_hidden_mass_is_found_far_better_than_by_the_open_loop(runs, kind, share):
    """Mean error over that of [paper]'s method on the same frames; the aim is 0.5 of it.

    Tolerance: 0.10 quiet and 0.20 poked is what these seeds give, half as much again is allowed.
    """
    paper = size(runs[kind].open_loop).mean()
    assert 4e-3 < paper < 8e-3  # the baseline is not made bad: evidence has 6.23 mm
    assert size(runs[kind].errors).mean() < share * paper


def test_its_covariance_can_be_trusted_and_nothing_diverges(runs):
    """95 % regions of chi-square with 2 degrees hold 90 % of the frames of each kind and more; mean NEES below 2.6.

    No error is beyond 15 mm, which five deviations of the widest covariance are.
    """
    for run in runs.values():
        squared = normalised_error_squared(run.errors, run.covs)
        assert coverage(squared, 2) >= 0.90
        assert squared.mean() <= 2.6
        assert size(run.errors).max() < 0.015


def test_with_three_marks_in_ten_missing_it_is_still_to_be_trusted(phantom, rest_state):
    """Each mark missing with 30 %, poked: under half of the open loop's error, 95 % regions hold 90 to 99.5 %."""
    run = follow(phantom, rest_state, 3, True, 5.0, seen=0.7)
    assert size(run.errors).mean() < 0.5 * size(run.open_loop).mean()
    assert 0.90 <= coverage(normalised_error_squared(run.errors, run.covs), 2) <= 0.995
    assert size(run.errors).max() < 0.015


def test_in_space_too():
    """A tetrahedron hung by three anchors: its unseen fourth mass, pulled by tremor only, is found to a few mm.

    Three marks of 4 mm over 2 s of 30 frames: under 4.14 mm sqrt(3) and inside the 99.9 % region of 3 degrees, 16.27.
    """
    positions = 0.1 * np.array([[0, 0, 3], [3, 0, 3], [0, 3, 3], [0, 0, 0], [3, 0, 0], [0, 3, 0], [1, 1, -1.0]])
    springs = [(0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (3, 5), (3, 6), (4, 6), (5, 6), (0, 4), (1, 5), (2, 3), (0, 6)]
    names = ("A", "B", "C", "M1", "M3", "M4", "M2")
    constants = {"drag": 0.2, "friction": 0.02, "stiffness": 250.0, "damping": 0.6, "gravity": [0.0, 0.0, -9.81]}
    drawn = build_network(positions, springs, range(3), names, **constants)
    rng = np.random.default_rng(0)
    forces = 0.2 * 0.05 * np.sqrt(120.0) * rng.normal(size=(240, 4, 3))
    states = driven(drawn, np.r_[rest_shape(drawn)[drawn.free].ravel(), np.zeros(12)], forces)[::EVERY]
    frames = [(k / 30.0, marks_of(drawn, state, MARK_SD, rng)) for k, state in enumerate(states)]
    estimate = followed(TissueFilter(drawn, "M2", OUTER), frames)[-1]
    error = estimate.mean - states[-1][drawn.coordinates("M2")]
    assert np.linalg.norm(error) < MARK_SD * np.sqrt(3.0)
    assert error @ np.linalg.solve(estimate.cov, error) < 16.27


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
