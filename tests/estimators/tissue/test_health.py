"""The state machine of health: every transition, the divergence test, and what a filter does with both."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, Health, MarkMeasurement, Status, TissueFilter
from estimators.tissue.health import after_frame, diverged
from tests.estimators.conftest import driven, followed, marks_of, poke_forces

SETTINGS = FilterSettings()
FINE, BAD = 6.0, 1e4
"""NIS of three marks, six coordinates: right, and beyond all doubt wrong."""


def walked(frames, health=None):
    """First letters of the statuses after frames (time [s], NIS or None), and the last health."""
    health, letters = Health() if health is None else health, ""
    for time_s, nis in frames:
        health = after_frame(health, time_s, nis, 0 if nis is None else 6, SETTINGS)
        letters += health.status.value[0]
    return letters, health


def tracked(until_s=1.0):
    """Health after marks that fit, 20 frames/s."""
    return walked([(t, FINE) for t in np.arange(0.0, until_s + 1e-9, 0.05)])[1]


@pytest.mark.parametrize(
    ("frames", "letters"),
    [
        ([(0.0, None), (5.0, None)], "II"),  # before marks, however long
        ([(0.0, FINE), (0.05, FINE), (0.09, FINE), (0.1, FINE), (0.2, FINE)], "IIITT"),
        ([(0.0, FINE), (0.05, None), (0.5, None), (0.51, FINE), (1.6, None)], "IIITL"),
    ],
)
def test_it_is_initialising_until_marks_were_taken_in_for_confirm_s(frames, letters):
    """0.1 s: one frame tells no velocity, and a gap after it confirms nothing."""
    assert walked(frames)[0] == letters


@pytest.mark.parametrize(
    ("frames", "letters"),
    [
        ([(1.05, None), (2.0, None), (2.01, None), (9.0, None), (9.1, FINE), (9.21, FINE), (9.25, None)], "CCLLITC"),
        ([(1.05, 120.0), (1.1, FINE)], "TT"),
        ([(1.05, BAD)], "D"),
        ([(1.05, BAD), (1.1, FINE), (1.2, None), (1.25, FINE), (1.29, FINE), (1.3, FINE)], "DDDDDT"),
        ([(1.05, BAD), (1.1, FINE), (2.2, None)], "DDL"),
        ([(1.05, BAD), (1.1, None), (2.05, None), (2.06, None)], "DDDL"),
    ],
)
def test_from_tracking_it_coasts_diverges_is_lost_and_starts_again(frames, letters):
    """COASTING up to and with lost_s = 1 s after the last mark, LOST beyond, INITIALISING with the next.

    A single NIS of 120 among five right ones within test_s is below ten sigma. DIVERGED lasts until marks fitted for
    0.25 s; without marks it does not coast, and is lost as ever.
    """
    assert walked(frames, tracked())[0] == letters


def test_a_slow_camera_loses_nothing(phantom, rest_state):
    """The paper's: a frame each 1.09 s, longer than lost_s, marks in every one. TRACKING, and never started again."""
    assert walked([(1.09 * k, FINE) for k in range(5)])[0] == "ITTTT"
    tissue, rng, spread = TissueFilter(phantom, HIDDEN, OUTER), np.random.default_rng(0), []
    for k in range(8):
        tissue.predict(1.09 * k)
        spread.append(np.trace(tissue.update(marks_of(phantom, rest_state, 0.00414, rng)).cov))
    assert tissue.repairs["restarted"] == 0
    assert spread[-1] < 0.5 * spread[0]


@pytest.mark.parametrize(
    "before", [(), ((0.0, FINE),), ((0.0, FINE), (0.2, FINE)), ((0.0, FINE), (0.2, FINE), (0.4, None))]
)
def test_it_diverges_from_wherever_marks_are_taken_in(before):
    """From INITIALISING, TRACKING and COASTING; the first frame of all is no test: there are none to compare with."""
    frames = [*before, (0.5, BAD), (0.55, BAD)]
    assert "D" in walked(frames)[0][-2:]


def test_the_first_frame_after_a_loss_is_tested_with_none_before_it():
    """Wrong beyond doubt, and still INITIALISING: frames from before the loss are forgotten."""
    letters, health = walked([(2.5, None), (2.6, BAD)], tracked())
    assert letters == "LI"
    assert health.innovations == ((2.6, BAD, 6),)


@pytest.mark.parametrize(("period_s", "together"), [(1 / 32, 8), (1 / 16, 4), (1 / 8, 2), (1 / 4, 2), (1 / 2, 2)])
def test_the_frames_of_test_s_are_tested_together_two_at_least(period_s, together):
    """Those later than test_s = 1/4 s ago, times without rounding: 1/4 s over the period of them."""
    _, health = walked([(k * period_s, FINE) for k in range(12)])
    assert health.innovations == tuple((k * period_s, FINE, 6) for k in range(12 - together, 12))


def test_frames_that_are_each_likely_enough_diverge_together():
    """NIS of 39 for six degrees, after frames of 6: with the sixth of them eight frames together pass ten sigma.

    Chi-square points of ten sigma: 122 for one frame, 220 for eight; ten per cent for the cube root, as above.
    """
    alone, limit = chi2.isf(norm.sf(10.0), [6, 48])
    assert alone > 39.0
    assert limit > 5 * 39.0 + 3 * FINE
    assert 1.1 * limit < 6 * 39.0 + 2 * FINE
    letters, _ = walked([(k / 32, FINE) for k in range(12)] + [(k / 32, 39.0) for k in range(12, 18)])
    assert letters[12:] == "TTTTTD"


def test_frames_of_no_coordinates_are_no_divergence():
    assert not diverged(((0.0, 0.0, 0), (0.1, 0.0, 0)), 10.0)


@pytest.mark.parametrize("degrees", [4, 12, 48, 300])
def test_the_limit_is_the_chi_square_point_of_that_many_sigma(degrees):
    """Wilson and Hilferty's cube root against chi2.isf(norm.sf(6)), 8 % high at four degrees and less beyond."""
    limit = chi2.isf(norm.sf(6.0), degrees)
    assert not diverged(((0.0, 0.5 * 0.99 * limit, degrees // 2),) * 2, 6.0)
    assert diverged(((0.0, 0.5 * 1.10 * limit, degrees // 2),) * 2, 6.0)


def test_right_innovations_are_never_taken_for_divergence():
    """Ten sigma: not once in 5,000 frames of chi-square variables."""
    rng = np.random.default_rng(0)
    letters, _ = walked([(k / 30.0, float(q)) for k, q in enumerate(rng.chisquare(6, 5_000))])
    assert "D" not in letters


def test_marks_where_no_tissue_can_be_make_it_diverge_and_it_finds_back(phantom):
    """All marks 2 m aside for a third of a second, which nothing explains: DIVERGED within 0.5 s, started again."""
    at = dict(zip(phantom.names, phantom.positions, strict=True))
    tissue, frames = TissueFilter(phantom, HIDDEN, OUTER), []
    for k in range(60):
        off = np.array([2.0, 0.0]) if 30 <= k < 40 else np.array([0.0, 0.0])
        frames.append((k / 30.0, [MarkMeasurement(n, at[n] + off, 1e-6 * np.eye(2)) for n in OUTER]))
    estimates = followed(tissue, frames)
    statuses = [e.status for e in estimates]
    assert Status.DIVERGED not in statuses[:30]
    first = statuses.index(Status.DIVERGED)
    assert first - 30 <= 15
    assert tissue.repairs["restarted"] >= 1
    assert np.trace(estimates[first].cov) > 40.0 * np.trace(estimates[29].cov)
    assert statuses[55:] == [Status.TRACKING] * 5
    np.testing.assert_allclose(estimates[-1].mean, at[HIDDEN], atol=3e-3)


def test_two_seconds_without_marks(phantom, rest_state, hidden):
    """COASTING, then LOST; the covariance grows; within 0.5 s of the marks' return the target is in its region."""
    rng = np.random.default_rng(0)
    states = driven(phantom, rest_state, poke_forces(phantom, 3.2, rng))[::4]
    seen = [[] if 20 <= k < 80 else marks_of(phantom, states[k], 0.00414, rng) for k in range(96)]
    estimates = followed(TissueFilter(phantom, HIDDEN, OUTER), [(k / 30.0, marks) for k, marks in enumerate(seen)])
    assert {(e.marks_used, e.nis) for e in estimates[20:80]} == {(0, None)}
    unseen = [e.status.value for e in estimates[20:80]]
    assert unseen[:29] + unseen[31:] == ["COASTING"] * 29 + ["LOST"] * 29  # a second, but for rounding
    spread = [np.trace(e.cov) for e in estimates[19:50]]
    assert spread[10] > spread[0]
    assert spread[-1] > 5.0 * spread[0]
    again = estimates[95]
    assert again.status is Status.TRACKING
    assert np.trace(again.cov) < 4.0 * np.trace(estimates[19].cov) + 1e-4
    off = again.mean - states[95][hidden]
    assert off @ np.linalg.solve(again.cov, off) < 13.8
