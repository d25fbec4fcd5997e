"""The filter under frames and bodies that are out of the ordinary."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, NetworkError
from estimators import FilterSettings, FixBias, ForceMode, MarkMeasurement
from estimators.core import Places, TissueFilter
from estimators.tissue.estimate import Status
from experiments.simulation.bodies.zoo import make_body
from tests.estimators.conftest import resting_frames

SD_M = 5e-4
HZ = 1 / 30


def at_rest(network, times_s, sd_m):
    """Frames of the outer marks at rest, by independent errors of this standard deviation [m]."""
    frames = resting_frames(network, len(times_s), sd_m)
    return [(float(time_s), marks) for time_s, (_, marks) in zip(times_s, frames, strict=True)]


def estimates(network, target, marked, frames):
    """What the filter states of frames; covariances of its state are symmetric and positive to rounding."""
    unified = TissueFilter(network, target, marked)
    found = [one for [one] in unified.run(frames)]
    covs = unified.filter.covs
    assert np.array_equal(covs, covs.swapaxes(1, 2))
    values = np.linalg.eigvalsh(covs)
    assert (values[:, 0] >= -1e-12 * values[:, -1]).all()
    for one in found:
        assert np.isfinite(one.mean).all()
        assert (np.linalg.eigvalsh(one.cov) > 0.0).all()
    return found


TIMES = {
    "gap 0.2 s": (np.r_[0.0:0.5:HZ, 0.7:1.2:HZ], 1),
    "gap 10 s": (np.r_[0.0:0.5:HZ, 10.5:11.0:HZ], 1),
    "5 a second": (np.arange(0.0, 3.0, 0.2), 1),
    "240 a second": (np.arange(0.0, 0.2, 1 / 240), 1),
    "equal times": (np.repeat(np.arange(0.0, 0.5, HZ), 2), 1),
    "since an epoch": (1e9 + np.arange(0.0, 0.5, HZ), 1),
    "marks of 1 um": (np.arange(0.0, 0.5, HZ), 1e-6 / SD_M),
    "marks of 1 m": (np.arange(0.0, 0.5, HZ), 1.0 / SD_M),
}


@pytest.mark.parametrize("case", TIMES)
def test_a_body_at_rest_is_found_within_its_covariance_whatever_the_frames(phantom, case):
    times_s, share = TIMES[case]
    found = estimates(phantom, HIDDEN, OUTER, at_rest(phantom, times_s, share * SD_M))
    error = np.array([one.mean for one in found]) - phantom.positions[phantom.index(HIDDEN)]
    squared = [e @ np.linalg.solve(one.cov, e) for e, one in zip(error, found, strict=True)]
    assert max(squared) < 25.0  # five standard deviations
    assert found[-1].status == Status.TRACKING


@pytest.mark.parametrize("size", [0.01, 100.0])
def test_a_body_of_another_size_under_the_same_gravity_is_found_as_exactly_by_its_size(phantom, size):
    small = replace(
        phantom,
        positions=size * phantom.positions,
        rest_lengths=size * phantom.rest_lengths,
        masses=size**3 * phantom.masses,
        stiffness=size**2 * phantom.stiffness,
        damping=size**2.5 * phantom.damping,
        drag=size**2.5 * phantom.drag,
    )
    last = estimates(small, HIDDEN, OUTER, at_rest(small, np.arange(0.0, 0.5, HZ), size * SD_M))[-1]
    error = last.mean - small.positions[small.index(HIDDEN)]
    assert last.status == Status.TRACKING
    assert error @ np.linalg.solve(last.cov, error) < 25.0
    assert np.sqrt(np.trace(last.cov)) < 0.1 * size  # the phantom is 0.4 m high


def test_a_filter_without_marked_nodes_says_so(phantom):
    with pytest.raises(ValueError, match="marked: expected one free node or more, found none"):
        TissueFilter(phantom, HIDDEN, [])
    with pytest.raises(ValueError, match="marked: expected one free node or more, found the text 'M1'"):
        TissueFilter(phantom, HIDDEN, "M1")


def test_a_snapshot_of_another_filter_is_refused_and_an_empty_path_has_the_usual_shapes(phantom):
    tissue, other = TissueFilter(phantom, HIDDEN, OUTER), TissueFilter(phantom, HIDDEN, OUTER[:1])
    other.predict(0.5)
    with pytest.raises(ValueError, match=r"snapshot: expected means of shape \(\d+, \d+\), found"):
        tissue.restore(other.snapshot())
    assert tissue.time_s is None
    with pytest.raises(ValueError, match=r"n_times, cycle_s: expected 1 or more and more than 0, found 3 and -0\.1"):
        other.tables(3, -0.1)
    for name in ("X", "In1"):
        with pytest.raises(NetworkError, match=name):
            other.expected(name)
    assert [each.shape for each in other.predict_path([])] == [(0, 2), (0, 2, 2)]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FilterSettings(gate=-1.0), "settings gate: expected more than 0, found -1.0"),
        (lambda: FilterSettings(lost_s=np.nan), "settings lost_s: expected 0 or more, found nan"),
        (lambda: FilterSettings(discrepancy=-0.1), "settings discrepancy: expected 0 or more, found -0.1"),
        (lambda: FilterSettings(led_nodes="M1"), "settings led_nodes: expected a list of names, found the text 'M1'"),
        (lambda: ForceMode(0.1, -5.0, 0.2), "forces poke: expected 0 or more, found -5.0"),
        (lambda: ForceMode(0.1, 5.0, 0.0), "forces lasting_s: expected more than 0, found 0.0"),
        (lambda: FixBias(-1e-3), "fix_bias sd_m: expected 0 or more, found -0.001"),
        (lambda: FixBias(1e-3, 0.0), "fix_bias lasting_s: expected more than 0, found 0.0"),
    ],
)
def test_settings_that_no_filter_can_have_are_refused(make, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        make()


def test_errors_that_marks_share_are_correlated():
    """Truth: covariance of z_i = own_i + s, all own_i and s independent, is sd_own² 1 + sd_s² on every pair."""
    own, shared = 1e-4, 3e-3
    marks = [MarkMeasurement(name, np.zeros(2), own**2 * np.eye(2), shared * np.eye(2)) for name in "ab"]
    marks.append(MarkMeasurement("c", np.zeros(2), own**2 * np.eye(2)))
    pairs = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    for noise in (1.0, 3.0):  # of the marks' own errors
        found = Places(marks, {name: np.eye(2) for name in "abc"}, noise=noise)
        assert found.noise_cov == pytest.approx((noise * own) ** 2 * np.eye(6))
        assert found.cov == pytest.approx(found.noise_cov + shared**2 * np.kron(pairs, np.eye(2)))
    with pytest.raises(ValueError, match="mark b shared: expected 2 directions, found 1"):
        Places([marks[0], replace(marks[1], shared=np.ones((2, 1)))], {name: np.eye(2) for name in "ab"})


def test_a_stiff_cable_that_swings_fast_does_not_run_away():
    """A few undamped linearisations leave springs at lengths that they cannot have, and the filter loses the cable."""
    body = make_body("cable-fast", 700, seconds=1.2)
    network, rng = body.network, np.random.default_rng(1)
    unified = TissueFilter(network, body.hidden[0], body.marked, FilterSettings(led_nodes=tuple(body.led)))
    errors = []
    for t, places in zip(body.times_s[:34], body.positions, strict=False):
        unified.predict(float(t))
        marks = [(name, places[network.index(name)]) for name in body.marked]
        cov = body.mark_sd_m**2 * np.eye(3)
        found = unified.update(
            [MarkMeasurement(name, at + body.mark_sd_m * rng.normal(size=3), cov) for name, at in marks]
        )
        errors.append(np.linalg.norm(found.mean - places[network.index(body.hidden[0])]))
    assert np.mean(errors[-8:]) < 0.05 * body.size_m
