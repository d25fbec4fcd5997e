"""Smoothing against the joint posterior, against all histories of two modes, and over seeded runs."""

from itertools import pairwise, product

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import (
    FixedLag,
    InteractingMixture,
    TissueFilter,
    UnifiedFilter,
    UnscentedKalmanFilter,
    coverage,
    fixed_interval,
    moment_matched,
    normalised_error_squared,
)
from estimators.filters.motion import ModeBeliefs
from estimators.smoothing.smoother import ForwardPass, smoothed_before
from experiments.simulation.bodies.zoo import make_body
from experiments.studies.zoo.constants import measured

H, R = np.array([[1.0, 0.0]]), np.array([[0.09]])
F = np.array([[1.0, 0.1], [0.0, 1.0]])
START = np.array([0.3, -0.2]), np.array([[1.0, 0.2], [0.2, 0.7]])


each_filter = pytest.mark.parametrize("made", [TissueFilter, UnifiedFilter])


def noise(q):
    """White acceleration of density q over 0.1 s, (2, 2), and a little of the place."""
    return q * np.array([[1e-3 / 3, 5e-3], [5e-3, 0.1]]) + 1e-6 * np.eye(2)


def passed(qs, zs, rates):
    """A mixture of modes that differ in noise, through measurements: its transitions and its filtered beliefs."""
    filters = []
    for q in qs:
        f = UnscentedKalmanFilter(2, lambda s, _dt: s @ F.T)
        f.x, f.P, f.Q = START[0].copy(), START[1].copy(), noise(q)
        filters.append(f)
    n = len(qs)
    mixture = InteractingMixture(filters, np.full(n, 1.0 / n), rates)
    mixture.trace = []
    filtered = []
    for k, z in enumerate(zs):
        if k:
            mixture.predict(0.1)
        mixture.update_linear(z, H, R)
        filtered.append(mixture.beliefs())
    return mixture.trace, filtered


def back(trace, filtered):
    """Smoothed beliefs of all times."""
    known = [filtered[-1]]
    for cycle, before in zip(reversed(trace), reversed(filtered[:-1]), strict=True):
        known.append(smoothed_before(known[-1], cycle, before))
    return known[::-1]


def posterior(qs_of_steps, zs):
    """Means (n, 2), covariances (n, 2, 2) of a linear chain given all measurements, and log evidence: one solve."""
    n = len(zs)
    precision, pull = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    precision[:2, :2], pull[:2] = np.linalg.inv(START[1]), np.linalg.solve(START[1], START[0])
    log_prior = -0.5 * np.linalg.slogdet(START[1])[1] - 0.5 * START[0] @ pull[:2]
    for k, q in enumerate(qs_of_steps):
        D = np.hstack([-F, np.eye(2)])
        own = slice(2 * k, 2 * k + 4)
        precision[own, own] += D.T @ np.linalg.solve(noise(q), D)
        log_prior -= 0.5 * np.linalg.slogdet(noise(q))[1]
    for k, z in enumerate(zs):
        precision[2 * k, 2 * k] += 1.0 / R[0, 0]
        pull[2 * k] += z[0] / R[0, 0]
    cov = np.linalg.inv(precision)
    mean = cov @ pull
    evidence = log_prior + 0.5 * pull @ mean - 0.5 * np.linalg.slogdet(precision)[1]
    blocks = np.array([cov[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(n)])
    return mean.reshape(n, 2), blocks, evidence


def test_of_modes_that_are_alike_it_is_the_joint_posterior():
    """However they turn into each other; linear and Gaussian, velocities never seen: dense least squares.

    1e-8: two chains of solves.
    """
    zs = np.random.default_rng(0).normal(size=(20, 1))
    trace, filtered = passed([0.5, 0.5], zs, np.array([[-1.0, 1.0], [3.0, -3.0]]))
    means, covs, _ = posterior([0.5] * 19, zs)
    known = back(trace, filtered)
    np.testing.assert_allclose([b.means[0] for b in known], means, rtol=0, atol=1e-8)
    np.testing.assert_allclose([b.covs[0] for b in known], covs, rtol=0, atol=1e-8)


def test_one_step_back_from_modes_that_do_not_mix_is_exact():
    """Two modes that never turn into each other are two chains: means, covariances and odds by Bayes. 1e-8."""
    zs = np.random.default_rng(1).normal(size=(8, 1))
    qs = [0.01, 5.0]
    known = back(*passed(qs, zs, np.zeros((2, 2))))
    chains = [posterior([q] * 7, zs) for q in qs]
    odds = np.exp([chain[2] - chains[0][2] for chain in chains])
    for k, belief in enumerate(known):
        np.testing.assert_allclose(belief.mu, odds / odds.sum(), rtol=0, atol=1e-8)
        for j, (means, covs, _) in enumerate(chains):
            np.testing.assert_allclose(belief.means[j], means[k], rtol=0, atol=1e-7)
            np.testing.assert_allclose(belief.covs[j], covs[k], rtol=0, atol=1e-7)


def test_of_modes_that_mix_it_is_near_the_sum_over_all_histories():
    """Five steps, 32 histories of two modes, each a linear chain.

    What merging costs is measured: 0.2 of a sigma, as much as it costs the filter at the last step, which is no
    smoother's doing; odds of the modes within 6 %. Without smoothing means are off by half a sigma and more.
    """
    rates = np.array([[-1.0, 1.0], [2.0, -2.0]])
    rng = np.random.default_rng(2)
    zs = np.cumsum(rng.normal(0.0, 0.5, (6, 1)), axis=0)
    qs = np.array([0.01, 8.0])
    trace, filtered = passed(qs, zs, rates)
    known = back(trace, filtered)
    turn = np.array([[0.9136, 0.0864], [0.1728, 0.8272]])  # exp(rates / 10), to four figures
    total, means, weights = 0.0, np.zeros((6, 2)), np.zeros((5, 2))
    histories = []
    for history in product((0, 1), repeat=5):
        prior = (0.5 * turn[0, history[0]] + 0.5 * turn[1, history[0]]) * np.prod(
            [turn[a, b] for a, b in pairwise(history)]
        )
        chain = posterior(qs[list(history)], zs)
        histories.append((history, np.log(prior) + chain[2], chain[0]))
    top = max(log for _, log, _ in histories)
    for history, log, mean in histories:
        w = np.exp(log - top)
        total += w
        means += w * mean
        weights[np.arange(5), history] += w
    means, weights = means / total, weights / total
    found = np.array([moment_matched(b.mu, b.means, b.covs)[0] for b in known])
    sigma = np.sqrt(np.array([np.diag(moment_matched(b.mu, b.means, b.covs)[1]) for b in known]))
    assert np.abs((found - means) / sigma).max() < 0.2
    assert np.abs((found - means) / sigma)[:-2].max() < 0.03
    np.testing.assert_allclose([b.mu for b in known[1:]], weights, rtol=0, atol=0.06)
    alone = np.array([moment_matched(b.mu, b.means, b.covs)[0] for b in filtered])
    assert np.abs((alone[:-1] - means[:-1]) / sigma[:-1]).max() > 0.5


@pytest.fixture(scope="module")
def runs(phantom, rest_state, driven, poke_forces, marks_of):
    """Three poked runs of 3 s at 30 frames/s, 4.14 mm: frames and truth by DOP853."""
    found = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        states = driven(phantom, rest_state, poke_forces(phantom, 3.0, rng))[::4]
        found.append(([(k / 30.0, marks_of(phantom, s, 0.00414, rng)) for k, s in enumerate(states)], states))
    return found


@each_filter
def test_later_marks_make_the_target_surer_and_it_is_right(made, phantom, runs, hidden):
    """Mean error below 0.95 of the filter's, spread below 0.9 of it; 95 % regions hold 90 to 99 %."""
    errors, spreads, squared = [], [], []
    for frames, states in runs:
        tissue, filtered = made(phantom, HIDDEN, OUTER), []
        for time_s, marks in frames:
            tissue.predict(time_s)
            filtered.append(tissue.update(marks))
        smooth = fixed_interval(made(phantom, HIDDEN, OUTER), frames)
        assert [e.time_s for e in smooth] == [e.time_s for e in filtered]
        off = [np.array([e.mean for e in each]) - states[:, hidden] for each in (filtered, smooth)]
        errors.append([np.linalg.norm(o, axis=1).mean() for o in off])
        spreads.append([np.sqrt([np.trace(e.cov) for e in each]).mean() for each in (filtered, smooth)])
        squared.append(normalised_error_squared(off[1], [e.cov for e in smooth]))
        np.testing.assert_allclose(smooth[-1].mean, filtered[-1].mean, rtol=0, atol=1e-12)
    errors, spreads = np.mean(errors, axis=0), np.mean(spreads, axis=0)
    assert errors[1] < 0.95 * errors[0]
    assert spreads[1] < 0.9 * spreads[0]
    assert 0.9 < coverage(np.concatenate(squared), 2) < 0.99


def test_a_fixed_lag_is_the_fixed_interval_cut_off_there(phantom, runs):
    """Frames 20 to 30 of which 20 is 10/30 s old: the first of an interval's smoothing that ends at 30. 1e-9 m."""
    frames = runs[0][0][:31]
    lag = FixedLag(TissueFilter(phantom, HIDDEN, OUTER), lag_s=10 / 30.0 - 1e-9)
    told = [lag.take(*frame) for frame in frames]
    assert told[:10] == [None] * 10
    whole = fixed_interval(TissueFilter(phantom, HIDDEN, OUTER), frames)
    assert told[30].time_s == frames[20][0]
    np.testing.assert_allclose(told[30].mean, whole[20].mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(told[30].cov, whole[20].cov, rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="lag_s: expected 0 s or more"):
        FixedLag(TissueFilter(phantom, HIDDEN, OUTER), lag_s=-0.1)


@each_filter
def test_a_fix_tells_of_before_and_after(made, phantom, runs, hidden):
    """Of the target to 0.1 mm, half way between frames 44 and 45: both become surer, and are as sure as they should be.

    Marks are of 4 mm. The last frame is the filter's own, with the fix; fixes beside the frames change nothing.
    """
    frames, states = runs[2][0][:60], runs[2][1]
    place = states[44:46, hidden].mean(axis=0) + np.array([1e-4, -0.5e-4])
    time_s, cov = 44.5 / 30.0, 1e-8 * np.eye(2)
    without = fixed_interval(made(phantom, HIDDEN, OUTER), frames)
    found = fixed_interval(made(phantom, HIDDEN, OUTER), frames, fixes=[(time_s, place, cov)])
    assert [e.time_s for e in found] == [t for t, _ in frames]
    for k in (44, 45):
        assert np.trace(found[k].cov) < 0.5 * np.trace(without[k].cov)
        off = (found[k].mean - states[k, hidden])[None]
        assert normalised_error_squared(off, found[k].cov[None])[0] < 9.2  # 99 %
    tissue = made(phantom, HIDDEN, OUTER)
    for k, frame in enumerate(frames):
        if k == 45:
            tissue.predict(time_s)
            tissue.fix(place, cov)
        tissue.predict(frame[0])
        last = tissue.update(frame[1])
    np.testing.assert_allclose(found[-1].mean, last.mean, rtol=0, atol=1e-12)
    beside = fixed_interval(made(phantom, HIDDEN, OUTER), frames, fixes=[(10.0, place, cov), (-1.0, place, cov)])
    np.testing.assert_array_equal([e.mean for e in beside], [e.mean for e in without])


@each_filter
def test_nothing_is_told_across_a_new_start(made, phantom, runs):
    """Marks lost for 1.5 s, longer than lost_s, then a new start: what comes after changes no estimate of before."""
    frames = runs[1][0]
    gap = [(t, marks if k < 30 or k >= 75 else []) for k, (t, marks) in enumerate(frames)]
    whole = fixed_interval(made(phantom, HIDDEN, OUTER), gap)
    cut = fixed_interval(made(phantom, HIDDEN, OUTER), gap[:75])
    np.testing.assert_array_equal([e.mean for e in whole[:75]], [e.mean for e in cut])


def test_beliefs_are_what_the_modes_believe():
    trace, filtered = passed([0.1, 1.0], np.zeros((3, 1)), np.zeros((2, 2)))
    assert len(trace) == 2
    assert isinstance(trace[0].arrived, ModeBeliefs)
    assert filtered[0].means.shape == (2, 2)
    np.testing.assert_allclose(trace[0].F, [F, F], rtol=0, atol=1e-12)


def test_a_smoother_goes_back_by_the_motion_that_the_update_linearised_again():
    """Of a cable that is led fast, each frame's transition is that of the filter after its update, to the last bit."""
    body = make_body("cable-fast", 1, seconds=0.3)
    tissue, again = TissueFilter(body.network, body.hidden[0], body.marked), 0
    passage = ForwardPass(TissueFilter(body.network, body.hidden[0], body.marked))
    for time_s, marks in zip(body.times_s.tolist(), measured(body, body.marked, 1), strict=True):
        step = passage.take(time_s, marks)
        tissue.mixture.trace = []
        tissue.predict(time_s)
        before = tissue.mixture.trace[-1].F if tissue.mixture.trace else None
        tissue.update(marks)
        if step.cycles:
            np.testing.assert_array_equal(step.cycles[-1].F, tissue.mixture.trace[-1].F)
            again += not np.array_equal(before, tissue.mixture.trace[-1].F)
    assert again > 2
