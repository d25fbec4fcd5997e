"""Each mark predicted as if it were hidden: the check that needs no truth, and what it makes of the covariance."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, parameters, scale_parameters
from estimators import LeaveOneOut, Status, TissueFilter, chi_square_bounds
from tests.estimators.conftest import driven, marks_of, poke_forces

SD = 0.001


@pytest.fixture(scope="module")
def motion(phantom, rest_state):
    """States of the poked phantom at 30 frames/s for 3 s."""
    return driven(phantom, rest_state, poke_forces(phantom, 3.0, np.random.default_rng(1)))[::4]


def followed(network, reported, states, marks_of):
    """A LeaveOneOut of `reported` on marks of `network`'s motion; checks, estimates and truth of all frames."""
    rng = np.random.default_rng(1)
    both = LeaveOneOut(reported, HIDDEN, OUTER)
    checks, estimates = [], []
    for k, state in enumerate(states):
        both.predict(k / 30.0)
        estimates.append(both.update(marks_of(network, state, SD, rng)))
        checks.append(dict(both.checks))
    return both, checks, estimates, states[:, 2:4]


@pytest.fixture(scope="module")
def right(phantom, motion):
    return followed(phantom, phantom, motion, marks_of)


@pytest.fixture(scope="module")
def wrong(phantom, motion):
    """The same motion, the filters with springs wrong by 30 %, and rest lengths by 3 %, at random."""
    which = parameters(phantom, ("stiffness", "rest_length"))
    off = np.array([0.3 if one.kind == "stiffness" else 0.03 for one in which])
    change = off * np.random.default_rng(0).normal(size=len(which))
    return followed(phantom, scale_parameters(phantom, which, change), motion, marks_of)


def test_a_withheld_mark_is_predicted_by_a_filter_that_never_had_it(phantom, rest_state):
    """Error and NEES of M3 from a TissueFilter aimed at M3 and fed with the other marks alone. Rounding."""
    rng = np.random.default_rng(2)
    both = LeaveOneOut(phantom, HIDDEN, OUTER)
    alone = TissueFilter(phantom, "M3", OUTER)
    for k in range(10):
        marks = [mark for mark in marks_of(phantom, rest_state, SD, rng) if k != 5 or mark.node != "M1"]
        both.predict(k / 30.0)
        alone.predict(k / 30.0)
        both.update(marks)
        predicted = alone.update([mark for mark in marks if mark.node != "M3"])
    mark = next(mark for mark in marks if mark.node == "M3")
    error = mark.position - predicted.mean
    np.testing.assert_allclose(both.checks["M3"].error, error, rtol=0, atol=1e-14)
    expected = error @ np.linalg.solve(predicted.cov + alone.level.noise**2 * mark.cov, error)
    assert both.checks["M3"].nees == pytest.approx(expected, rel=1e-9)


def test_withheld_marks_are_judged_with_what_the_calibration_moves_them_by(phantom, motion):
    """A filter without M1 errs by what moves M1, too: H P H' with the mark's own directions in H. 1e-9."""
    rng = np.random.default_rng(3)
    shared = {node: rng.normal(0.0, 1e-3, (2, 3)) for node in OUTER}
    both = LeaveOneOut(phantom, HIDDEN, OUTER, n_calibration=3)
    for k, state in enumerate(motion[:10]):
        marks = [replace(mark, shared=shared[mark.node]) for mark in marks_of(phantom, state, SD, rng)]
        both.predict(k / 30.0)
        both.update(marks)
    other, mark = both.without["M1"], next(mark for mark in marks if mark.node == "M1")
    x, P = other.filter.moments_by(other.filter.weights)
    H = other.process.node("M1")
    error = mark.position - H @ x
    H[:, other.process.parts["calibration"]] = mark.shared
    expected = error @ np.linalg.solve(H @ P @ H.T + mark.cov, error)
    assert both.checks["M1"].nees == pytest.approx(expected, rel=1e-9)


def test_checks_hold_and_leave_the_covariance_alone_where_the_model_is_right(right):
    """Mean NEES of withheld marks, 2 is right.

    90 frames, some 3 of them independent a second, three marks: 99.9 % chi-square bounds of the mean of 27.
    """
    both, checks, estimates, _ = right
    nees = [check.nees for frame in checks[30:] for check in frame.values()]
    low, high = chi_square_bounds(2 * 27, 0.999)
    assert len(nees) > 180
    assert low / 27 < np.mean(nees) < high / 27
    assert 1.0 <= both.scale < 1.6
    own = both.tissue.place_of(both.tissue.target)[1]
    np.testing.assert_allclose(estimates[-1].cov, both.scale * own, rtol=1e-12)


def test_a_wrong_model_is_noticed_and_the_covariance_grows(wrong):
    """Without truth the mean NEES of withheld marks is past the bound that the right model keeps.

    With truth: the target's own NEES is above 4 where 2 is right, and falls by more than a third.
    """
    both, checks, estimates, truth = wrong
    nees = [check.nees for frame in checks[30:] for check in frame.values()]
    assert np.mean(nees) > chi_square_bounds(2 * 27, 0.999)[1] / 27
    assert both.scale > 2.0
    errors = np.array([e.mean for e in estimates[60:]]) - truth[60:]
    scaled_nees = np.mean([e @ np.linalg.solve(x.cov, e) for e, x in zip(errors, estimates[60:], strict=True)])
    own = np.mean([both.scale * e @ np.linalg.solve(x.cov, e) for e, x in zip(errors, estimates[60:], strict=True)])
    assert own > 4.0
    assert scaled_nees < 0.6 * own


def test_no_check_of_a_mark_that_is_not_seen_or_not_predicted_yet(phantom, rest_state):
    both = LeaveOneOut(phantom, HIDDEN, OUTER)
    both.predict(0.0)
    estimate = both.update(marks_of(phantom, rest_state))
    assert estimate.status is Status.INITIALISING
    assert both.checks == {}
    both.predict(0.2)
    both.update(marks_of(phantom, rest_state, nodes=("M1", "M4")))
    assert set(both.checks) == {"M1", "M4"}


def test_two_marks_are_the_least(phantom):
    with pytest.raises(ValueError, match="expected two or more nodes, found 1"):
        LeaveOneOut(phantom, HIDDEN, ("M1",))


def test_outliers_are_not_checked_and_widen_nothing(phantom, motion):
    """M1 and M3 exchanged in every tenth frame: rejected, as 60 mm off, and no reason to doubt the model."""
    n_frames = iter(range(30))

    def swapped(*known):
        marks = marks_of(*known)
        if next(n_frames) % 10 != 9:
            return marks
        at = {mark.node: mark.position for mark in marks}
        return [replace(mark, position=at[{"M1": "M3", "M3": "M1"}.get(mark.node, mark.node)]) for mark in marks]

    both, checks, *_ = followed(phantom, phantom, motion[:30], swapped)
    assert not {"M1", "M3"} & set().union(*checks[9::10])
    assert all(one.nees < 100.0 for frame in checks for one in frame.values())
    assert both.scale < 1.5
