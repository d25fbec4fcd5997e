"""What noise of the marks makes of the open loop's target: against the open loop itself, driven by noise."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, state_matrix
from estimators import MarkMeasurement, OpenLoop, OpenLoopCovariance, accumulated_noise, chi_square_bounds
from estimators.process import open_loop_cov
from tests.networks import slab

SD = 1e-4
"""Noise of the marks [m]: so small that the phantom answers in proportion."""
R = SD**2 * np.eye(2)


@pytest.fixture(scope="module")
def smooth(phantom):
    """The phantom without friction, whose bend over 5 mm/s is no line."""
    return replace(phantom, friction=np.zeros(phantom.n_nodes))


def assert_consistent(errors, known):
    """Mean NEES of 30 errors, (30, 2), inside its 99.9 % chi-square bounds; by 1/2 or 2 it is far outside."""
    nees = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(known.target_cov), errors)
    low, high = chi_square_bounds(60, 0.999)
    assert low < nees.sum() < high


def noisy(network, nodes, rng):
    return [MarkMeasurement(n, network.positions[network.index(n)] + rng.normal(0.0, SD, 2), R) for n in nodes]


def test_its_covariance_is_that_of_the_open_loops_errors(smooth):
    """Marks 0.1 mm off: the phantom's second order is a thousandth of its first."""
    times = np.arange(20) / 10.0
    open_loop = OpenLoopCovariance(smooth, HIDDEN, OUTER, white=0.0)
    for dt in np.diff(times, prepend=0.0):
        open_loop.take(float(dt), dict.fromkeys(OUTER, R))
    errors = []
    for seed in range(30):
        rng, loop = np.random.default_rng(seed), OpenLoop(smooth, HIDDEN)
        ends = [loop.update(float(t), noisy(smooth, OUTER, rng)).mean for t in times]
        errors.append(ends[-1] - smooth.positions[smooth.index(HIDDEN)])
    assert_consistent(errors, open_loop)


def test_a_mark_that_is_not_seen_stays_where_it_was(smooth):
    """Only M3 seen from the second frame on: the others' first error holds them, and its covariance shows that."""
    times = np.arange(30) / 10.0
    open_loop = OpenLoopCovariance(smooth, HIDDEN, OUTER, white=0.0)
    for k, dt in enumerate(np.diff(times, prepend=0.0)):
        open_loop.take(float(dt), dict.fromkeys(OUTER if k == 0 else ("M3",), R))
    errors = []
    for seed in range(30):
        rng, loop = np.random.default_rng(seed), OpenLoop(smooth, HIDDEN)
        marks = {mark.node: mark for mark in noisy(smooth, OUTER, rng)}
        for k, t in enumerate(times):
            marks |= {mark.node: mark for mark in noisy(smooth, ("M3",), rng) if k}
            found = loop.update(float(t), list(marks.values())).mean
        errors.append(found - smooth.positions[smooth.index(HIDDEN)])
    assert_consistent(errors, open_loop)


def test_unknown_force_adds_what_it_does_to_the_hidden_mass(smooth):
    """Marks without noise, white force on the hidden mass alone: what its equation accumulates, in closed form."""
    white, seconds = 0.05, 1.0
    open_loop = OpenLoopCovariance(smooth, HIDDEN, OUTER, white=white)
    for _ in range(10):
        open_loop.take(seconds / 10, dict.fromkeys(OUTER, np.zeros((2, 2))))
    held = replace(smooth, fixed=[name in (*OUTER, "In1", "In2", "In3") for name in smooth.names])
    A, density = state_matrix(held, smooth.positions), np.diag([0.0, 0.0, white**2, white**2])
    expected = accumulated_noise(A, density, seconds)[:2, :2]
    np.testing.assert_allclose(open_loop.target_cov, expected, rtol=0, atol=1e-6 * np.trace(expected))


def test_frames_of_any_length_give_the_same_when_nothing_is_seen(smooth):
    """Marks held: dx/dt = A x in closed form, however time is cut. Rounding of matrix exponentials."""
    covs = []
    for n in (1, 7):
        open_loop = OpenLoopCovariance(smooth, HIDDEN, OUTER, white=0.05)
        open_loop.take(0.0, dict.fromkeys(OUTER, R))
        for _ in range(n):
            open_loop.take(0.5 / n, {})
        covs.append(open_loop.cov)
    np.testing.assert_allclose(covs[0], covs[1], rtol=0, atol=1e-9 * SD**2 + 1e-9 * np.abs(covs[0]).max())


def test_the_slowest_motions_of_a_large_body_are_enough(monkeypatch):
    """A third of the coordinates, against all: the target's variance to 2 %, after frames with and without a mark."""
    body, marked, R3 = slab(), ["N79", "N76", "N67", "N64"], SD**2 * np.eye(3)

    def covariance(motions):
        monkeypatch.setattr(open_loop_cov, "MOTIONS", motions)
        known = OpenLoopCovariance(body, "N58", marked, white=1e-3)
        for k in range(12):
            known.take(1.0 / 30.0, dict.fromkeys(marked[: 4 - k % 2], R3))
        return known

    few, every = covariance(60), covariance(1000)
    assert len(few.cov) == 2 * 60 + 12
    assert len(every.cov) == 2 * 3 * (len(body.free) - 4) + 12
    np.testing.assert_allclose(few.target_cov, every.target_cov, atol=0.02 * np.trace(every.target_cov))
