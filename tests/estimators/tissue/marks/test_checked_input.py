"""Input that cannot be a measurement: one clear ValueError, and the filter as it was."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import MarkMeasurement, TissueFilter
from tests.estimators.states import digest

NAN = float("nan")
SD = 1e-3
NO_COVARIANCES = {
    "negative": -(SD**2) * np.eye(2),
    "negative in one direction": SD**2 * np.array([[1.0, 2.0], [2.0, 1.0]]),
    "zero": np.zeros((2, 2)),
    "not symmetric": SD**2 * np.array([[1.0, 0.5], [0.1, 1.0]]),
    "nan": np.array([[SD**2, 0.0], [0.0, NAN]]),
    "infinite": np.diag([SD**2, np.inf]),
    "a number": np.array(SD**2),
    "another dimension": SD**2 * np.eye(3),
}


@pytest.mark.parametrize("cov", NO_COVARIANCES.values(), ids=NO_COVARIANCES.keys())
def test_a_mark_has_a_covariance(cov):
    with pytest.raises(ValueError, match=r"^mark M3"):
        MarkMeasurement("M3", np.zeros(2), cov)


@pytest.mark.parametrize(
    "shared", [np.array([[NAN], [0.0]]), np.array([[np.inf], [0.0]]), np.zeros(2), np.zeros((3, 1))]
)
def test_what_marks_share_is_finite_and_has_their_dimension(shared):
    with pytest.raises(ValueError, match=r"^mark M3 shared: expected"):
        MarkMeasurement("M3", np.zeros(2), SD**2 * np.eye(2), shared)


@pytest.mark.parametrize("position", [np.array([NAN, 0.0]), np.array([np.inf, 0.0]), np.zeros((2, 1)), np.array(0.0)])
def test_a_mark_has_a_place(position):
    with pytest.raises(ValueError, match=r"^mark M3"):
        MarkMeasurement("M3", position, SD**2 * np.eye(2))


def test_a_mark_stays_what_was_checked():
    """Its arrays are its own: the caller's may be used again for the next frame."""
    position, cov = np.zeros(2), SD**2 * np.eye(2)
    mark = MarkMeasurement("M3", position, cov)
    position[:], cov[:] = NAN, NAN
    assert np.isfinite(mark.position).all()
    with pytest.raises(ValueError, match="read-only"):
        mark.cov[0, 0] = -1.0


@pytest.mark.parametrize("cov", NO_COVARIANCES.values(), ids=NO_COVARIANCES.keys())
def test_a_fix_has_a_covariance(cov, warmed, rest_state, hidden):
    tissue = warmed(SD)
    before = digest(tissue.snapshot())
    with pytest.raises(ValueError, match=r"^fix"):
        tissue.fix(rest_state[hidden], cov)
    assert digest(tissue.snapshot()) == before


@pytest.mark.parametrize("position", [np.array([NAN, 0.0]), np.array([0.0, -np.inf]), np.zeros(3), np.zeros((1, 2))])
def test_a_fix_has_a_place(position, warmed):
    tissue = warmed(SD)
    before = digest(tissue.snapshot())
    with pytest.raises(ValueError, match=r"^fix"):
        tissue.fix(position, SD**2 * np.eye(2))
    assert digest(tissue.snapshot()) == before


def shared_sigma(phantom, rest_state, marks_of, without):
    """Sigma of the target [m] after ten frames whose marks, but for those of `without`, share a shift of 1 mm."""
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    for k in range(10):
        tissue.predict(k / 30.0)
        marks = [
            MarkMeasurement(m.node, m.position, 1e-8 * np.eye(2), None if m.node in without else 1e-3 * np.eye(2))
            for m in marks_of(phantom, rest_state)
        ]
        estimate = tissue.update(marks)
    return float(np.sqrt(np.trace(estimate.cov)))


def test_a_mark_that_shares_no_error_leaves_the_others_theirs(phantom, rest_state, marks_of):
    """A filter does not become more certain by as much as if none of the marks shared an error.

    One frame's R is that of the textbook, D + F F', with a row of zeros in F; sigma lies between all and none.
    """
    all_share, one_without, none_share = (
        shared_sigma(phantom, rest_state, marks_of, without) for without in ((), ("M1",), OUTER)
    )
    assert none_share < one_without < all_share


def test_marks_of_a_frame_share_the_same_errors(warmed, phantom, rest_state, marks_of):
    """Two directions for one mark and one for the other cannot be of one calibration."""
    tissue = warmed(SD)
    first, second, _ = marks_of(phantom, rest_state)
    marks = [
        MarkMeasurement(first.node, first.position, first.cov, 1e-3 * np.ones((2, 2))),
        MarkMeasurement(second.node, second.position, second.cov, 1e-3 * np.ones((2, 1))),
    ]
    before = digest(tissue.snapshot())
    with pytest.raises(ValueError, match=r"mark M3 shared: expected 2 directions, found 1"):
        tissue.update(marks)
    assert digest(tissue.snapshot()) == before


def test_a_prediction_that_fails_on_the_way_changes_nothing(warmed):
    """A known force that cannot be told from 0.1 s on: a third of the way is not gone either."""
    tissue = warmed(SD)
    start_s = tissue.time_s

    def push(time_s, _states):
        if time_s > start_s + 0.1:
            raise RuntimeError("no force is known")
        return np.zeros((4, 2))

    before = digest(tissue.snapshot())
    with pytest.raises(RuntimeError, match="no force is known"):
        tissue.predict(start_s + 0.3, push)
    assert digest(tissue.snapshot()) == before
