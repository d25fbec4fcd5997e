"""The filter of the tissue: how far off, how sure of itself, and what it does when marks are missing."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, MassSpringNetwork, rest_shape
from estimators import (
    OpenLoop,
    Status,
    TissueFilter,
    coverage,
    normalised_error_squared,
)

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
    poked: np.ndarray
    pushed: np.ndarray


def follow(phantom, make, seed, poked, seen=1.0):
    """Eight seconds at 30 frames/s from rest, poked ten; each mark is seen with probability `seen`."""
    driven, poke_forces, marks_of, rest_state = make
    rng, hidden = np.random.default_rng(seed), phantom.coordinates(HIDDEN)
    forces = poke_forces(phantom, 10.0 if poked else 8.0, rng, poked=poked)
    states = driven(phantom, rest_state, forces)[::EVERY]
    ours, loop = TissueFilter(phantom, HIDDEN, OUTER), OpenLoop(phantom, HIDDEN)
    estimates, others = [], []
    for k, state in enumerate(states):
        marks = [mark for mark in marks_of(phantom, state, MARK_SD, rng) if rng.random() < seen]
        t = k * EVERY / 120.0
        ours.predict(t)
        estimates.append(ours.update(marks))
        others.append(loop.update(t, marks).mean)
        assert estimates[-1].marks_used == len(marks)
    pushed = np.abs(forces).max(axis=(1, 2))[::EVERY] > 1.0  # N, three times what tremor reaches
    return Followed(
        errors=np.array([e.mean for e in estimates]) - states[:, hidden],
        open_loop=np.array(others) - states[:, hidden],
        covs=np.array([e.cov for e in estimates]),
        poked=np.array([e.poked for e in estimates]),
        pushed=np.append(pushed, False)[: len(states)],
    )


@pytest.fixture(scope="module")
def make(driven, poke_forces, marks_of, rest_state):
    return driven, poke_forces, marks_of, rest_state


@pytest.fixture(scope="module")
def runs(phantom, make):
    """A quiet run and a poked one."""
    seeds = {"quiet": (0,), "poked": (0,)}
    return {kind: [follow(phantom, make, seed, kind == "poked") for seed in some] for kind, some in seeds.items()}


def size(errors):
    return np.linalg.norm(errors, axis=1)


@pytest.mark.parametrize(("kind", "share"), [("quiet", 0.15), ("poked", 0.3)])
def test_hidden_mass_is_found_far_better_than_by_the_open_loop(runs, kind, share):
    """Mean error over that of [paper]'s method on the same frames; the aim is 0.5 of it.

    Tolerance: 0.10 quiet and 0.20 poked is what these seeds give, half as much again is allowed.
    """
    ours = np.mean([size(run.errors).mean() for run in runs[kind]])
    paper = np.mean([size(run.open_loop).mean() for run in runs[kind]])
    assert 4e-3 < paper < 8e-3  # the baseline is not made bad: evidence has 6.23 mm
    assert ours < share * paper


def test_its_covariance_can_be_believed(runs):
    """95 % regions of chi-square with 2 degrees hold 90 % of the frames of each kind and more; mean NEES below 2.6."""
    squared = {
        kind: np.concatenate([normalised_error_squared(run.errors, run.covs) for run in some])
        for kind, some in runs.items()
    }
    assert coverage(np.concatenate(list(squared.values())), 2) >= 0.90
    for some in squared.values():
        assert coverage(some, 2) >= 0.90
        assert some.mean() <= 2.6


def test_nothing_diverges(runs):
    """No error beyond 15 mm, which five deviations of the widest covariance are, in any of 542 frames."""
    errors = np.concatenate([size(run.errors) for some in runs.values() for run in some])
    assert len(errors) == 542
    assert errors.max() < 0.015


def test_a_poke_is_told_from_quiet(runs):
    """Poked: 0.09 on average while an outer mass is pushed by over 1 N, below a fifth of that quiet."""
    pushed = np.concatenate([run.poked[run.pushed] for run in runs["poked"]])
    assert len(pushed) > 20
    assert pushed.mean() > 0.05
    assert np.concatenate([run.poked for run in runs["quiet"]]).mean() < 0.2 * pushed.mean()


def test_with_three_marks_in_ten_missing_it_is_still_to_be_believed(phantom, make):
    """Each mark missing with 30 %, poked: under half of the open loop's error, 95 % regions hold 90 to 99.5 %."""
    run = follow(phantom, make, 3, True, seen=0.7)
    assert size(run.errors).mean() < 0.5 * size(run.open_loop).mean()
    assert 0.90 <= coverage(normalised_error_squared(run.errors, run.covs), 2) <= 0.995
    assert size(run.errors).max() < 0.015


def test_without_marks_it_grows_unsure_then_says_lost_then_finds_back(phantom, rest_state, marks_of, warmed):
    """COASTING up to and with lost_s = 1 s after the last mark, LOST beyond, started again with the next mark.

    The largest variance of the target grows with every unseen frame of the first 0.3 s.
    """
    ours = warmed(MARK_SD)
    last = ours.seen_s
    estimates = []
    for k in range(1, 46):
        ours.predict(last + k / 30.0)
        estimates.append(ours.update([]))
    assert [e.status for e in estimates[:30]] == [Status.COASTING] * 30
    assert [e.status for e in estimates[30:]] == [Status.LOST] * 15
    assert {(e.marks_used, e.nis) for e in estimates} == {(0, None)}
    largest = [np.linalg.eigvalsh(e.cov)[-1] for e in estimates]
    assert all(b > a for a, b in pairwise(largest[:10]))
    assert 4.0 * largest[0] < largest[-1]
    ours.predict(last + 46 / 30.0)
    found = ours.update(marks_of(phantom, rest_state, MARK_SD, np.random.default_rng(2), nodes=("M3",)))
    assert found.status is Status.INITIALISING
    assert ours.repairs == {"restarted": 1}
    assert np.linalg.eigvalsh(found.cov)[-1] < 1.5 * largest[-1]  # one mark, and no memory of before, nor of a tremor


def test_in_space_too(driven, marks_of):
    """A tetrahedron hung by three anchors: its unseen fourth mass, pulled by tremor only, is found to a few mm.

    Three marks of 4 mm over 2 s of 30 frames: under 4.14 mm sqrt(3) and inside the 99.9 % region of 3 degrees, 16.27.
    """
    positions = 0.1 * np.array([[0, 0, 3], [3, 0, 3], [0, 3, 3], [0, 0, 0], [3, 0, 0], [0, 3, 0], [1, 1, -1.0]])
    springs = [(0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (3, 5), (3, 6), (4, 6), (5, 6), (0, 4), (1, 5), (2, 3), (0, 6)]
    pairs = np.array(springs)
    drawn = MassSpringNetwork(
        names=("A", "B", "C", "M1", "M3", "M4", "M2"),
        positions=positions,
        masses=np.full(7, 0.2),
        fixed=np.arange(7) < 3,
        drag=np.full(7, 0.2),
        friction=np.full(7, 0.02),
        springs=pairs,
        stiffness=np.full(13, 250.0),
        rest_lengths=np.linalg.norm(positions[pairs[:, 1]] - positions[pairs[:, 0]], axis=1),
        damping=np.full(13, 0.6),
        gravity=np.array([0.0, 0.0, -9.81]),
    )
    rest = rest_shape(drawn)[drawn.free]
    rng = np.random.default_rng(0)
    forces = 0.2 * 0.05 * np.sqrt(120.0) * rng.normal(size=(240, 4, 3))
    states = driven(drawn, np.r_[rest.ravel(), np.zeros(12)], forces)[::EVERY]
    ours, place = TissueFilter(drawn, "M2", OUTER), drawn.coordinates("M2")
    for k, state in enumerate(states):
        ours.predict(k / 30.0)
        estimate = ours.update(marks_of(drawn, state, MARK_SD, rng))
    error = estimate.mean - states[-1][place]
    assert np.linalg.norm(error) < MARK_SD * np.sqrt(3.0)
    assert error @ np.linalg.solve(estimate.cov, error) < 16.27
