"""The filter of the tissue: how far off, how sure of itself, and what it does when marks are missing."""

from dataclasses import dataclass

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import OpenLoop, TissueFilter, coverage, normalised_error_squared
from tests.estimators.conftest import driven, followed, marks_of, poke_forces, poked_frames

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
    return {"quiet": follow(phantom, rest_state, 0, False, 3.0), "poked": follow(phantom, rest_state, 0, True, 4.0)}


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
    run = follow(phantom, rest_state, 3, True, 3.0, seen=0.7)
    assert size(run.errors).mean() < 0.5 * size(run.open_loop).mean()
    assert 0.90 <= coverage(normalised_error_squared(run.errors, run.covs), 2) <= 0.995
    assert size(run.errors).max() < 0.015


def test_where_it_will_be_can_be_trusted(phantom):
    """0.1 s ahead, every third frame of a poked run of 3 s: 90 to 99 % of the truths lie in the 95 % region.

    Truth by DOP853 under half-sine pokes that the filter takes for Gauss-Markov noise.
    """
    ahead, squared = 3, []
    frames, states = poked_frames(3.0, MARK_SD, 1)
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    for k, frame in enumerate(frames[:-ahead]):
        followed(tissue, [frame])
        if k % 3:
            continue
        said = tissue.predict_at(frames[k + ahead][0])
        off = said.mean - states[k + ahead][phantom.coordinates(HIDDEN)]
        squared.append(normalised_error_squared(off[None], said.cov[None])[0])
    assert 0.90 <= coverage(squared, 2) <= 0.99
