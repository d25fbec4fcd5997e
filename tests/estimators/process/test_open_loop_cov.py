"""What noise of the marks makes of the open loop's target: against the open loop itself, driven by noise."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, pack, unpack
from estimators import MarkMeasurement, OpenLoop, OpenLoopCovariance, chi_square_bounds

SD = 1e-4
"""Noise of the marks [m]: so small that the phantom answers in proportion."""
R = SD**2 * np.eye(2)


@pytest.fixture(scope="module")
def smooth(phantom):
    """The phantom without friction, whose bend over 5 mm/s is no line."""
    return replace(phantom, friction=np.zeros(phantom.n_nodes))


def open_loop_errors(network, times, rng, seen=lambda k, node: True):
    """Error of the open loop's target at each time, the tissue at rest, marks with noise, (n, 2)."""
    loop = OpenLoop(network, HIDDEN)
    errors = []
    for k, t in enumerate(times):
        marks = [
            MarkMeasurement(node, network.positions[network.index(node)] + rng.normal(0.0, SD, 2), R)
            for node in OUTER
            if seen(k, node)
        ]
        errors.append(loop.update(float(t), marks).mean - network.positions[network.index(HIDDEN)])
    return np.array(errors)


@pytest.mark.parametrize("rate", [5.0, 30.0])
def test_its_covariance_is_that_of_the_open_loops_errors(smooth, rate):
    """Mean NEES of 30 open loops at a fixed time inside its 99.9 % chi-square bounds; by 1/2 or 2 it is far outside.

    Marks 0.1 mm off: the phantom's second order is a thousandth of its first.
    """
    times = np.arange(40) / rate
    belief = OpenLoopCovariance(smooth, HIDDEN, OUTER, white=0.0)
    for dt in np.diff(times, prepend=0.0):
        belief.take(float(dt), dict.fromkeys(OUTER, R))
    errors = np.array([open_loop_errors(smooth, times, np.random.default_rng(s))[-1] for s in range(30)])
    nees = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(belief.target_cov), errors)
    low, high = chi_square_bounds(60, 0.999)
    assert low < nees.sum() < high


def test_a_mark_that_is_not_seen_stays_where_it_was(smooth):
    """Only M3 seen from the second frame on: the others' first error holds them, and the belief has it so.

    Variance of the target by the open loop whose unseen masses are put where they were seen first: mean NEES of 30.
    """
    times = np.arange(60) / 10.0
    belief = OpenLoopCovariance(smooth, HIDDEN, OUTER, white=0.0)
    for k, dt in enumerate(np.diff(times, prepend=0.0)):
        belief.take(float(dt), dict.fromkeys(OUTER if k == 0 else ("M3",), R))
    errors = []
    for seed in range(30):
        rng, first = np.random.default_rng(seed), {}
        loop = OpenLoop(smooth, HIDDEN)
        for k, t in enumerate(times):
            for node in OUTER if k == 0 else ("M3",):
                first[node] = smooth.positions[smooth.index(node)] + rng.normal(0.0, SD, 2)
            marks = [MarkMeasurement(node, place, R) for node, place in first.items()]
            found = loop.update(float(t), marks).mean
        errors.append(found - smooth.positions[smooth.index(HIDDEN)])
    nees = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(belief.target_cov), errors)
    low, high = chi_square_bounds(60, 0.999)
    assert low < nees.sum() < high


def test_unknown_force_adds_what_it_does_to_the_hidden_mass(smooth, driven):
    """Marks without noise, white force on the hidden mass alone, truth by DOP853: mean NEES of 30 inside 99.9 %."""
    white, seconds = 0.05, 1.0
    belief = OpenLoopCovariance(smooth, HIDDEN, OUTER, white=white)
    for _ in range(10):
        belief.take(seconds / 10, dict.fromkeys(OUTER, np.zeros((2, 2))))
    held = replace(smooth, fixed=[name in (*OUTER, "In1", "In2", "In3") for name in smooth.names])
    place = smooth.positions[smooth.index(HIDDEN)]
    start = pack(place[None], np.zeros((1, 2)))
    errors = []
    for seed in range(30):
        n = int(seconds * 120)
        forces = 0.2 * white * np.sqrt(120.0) * np.random.default_rng(seed).normal(size=(n, 1, 2))
        errors.append(unpack(driven(held, start, forces)[-1], 2)[0][0] - place)
    nees = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(belief.target_cov), errors)
    low, high = chi_square_bounds(60, 0.999)
    assert low < nees.sum() < high


def test_frames_of_any_length_give_the_same_when_nothing_is_seen(smooth):
    """Marks held: dx/dt = A x in closed form, however time is cut. Rounding of matrix exponentials."""
    beliefs = []
    for n in (1, 7):
        belief = OpenLoopCovariance(smooth, HIDDEN, OUTER, white=0.05)
        belief.take(0.0, dict.fromkeys(OUTER, R))
        for _ in range(n):
            belief.take(0.5 / n, {})
        beliefs.append(belief.cov)
    np.testing.assert_allclose(beliefs[0], beliefs[1], rtol=0, atol=1e-9 * SD**2 + 1e-9 * np.abs(beliefs[0]).max())
