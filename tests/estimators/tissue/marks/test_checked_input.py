"""Input that cannot be a measurement: one clear ValueError, and the filter as it was."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import MarkMeasurement, TissueFilter
from tests.estimators.conftest import followed
from tests.estimators.states import digest

NAN = float("nan")
SD = 1e-3
GOOD = np.zeros(2), SD**2 * np.eye(2)
BAD = {
    "negative": (GOOD[0], -(SD**2) * np.eye(2), " cov: expected a symmetric positive definite matrix"),
    "negative in one direction": (GOOD[0], SD**2 * np.array([[1.0, 2.0], [2.0, 1.0]]), " cov: expected a symmetric"),
    "zero": (GOOD[0], np.zeros((2, 2)), " cov: expected a symmetric positive definite matrix"),
    "not symmetric": (GOOD[0], SD**2 * np.array([[1.0, 0.5], [0.1, 1.0]]), " cov: expected a symmetric"),
    "nan": (GOOD[0], np.array([[SD**2, 0.0], [0.0, NAN]]), ": expected finite numbers"),
    "infinite": (GOOD[0], np.diag([SD**2, np.inf]), ": expected finite numbers"),
    "a number": (GOOD[0], np.array(SD**2), r" cov: expected shape \(2, 2\), found \(\)"),
    "variances alone": (GOOD[0], np.ones(2), r" cov: expected shape \(2, 2\), found \(2,\)"),
    "another dimension": (GOOD[0], SD**2 * np.eye(3), r" cov: expected shape \(2, 2\), found \(3, 3\)"),
    "no place": (np.array([NAN, 0.0]), GOOD[1], ": expected finite numbers"),
    "an infinite place": (np.array([0.0, -np.inf]), GOOD[1], ": expected finite numbers"),
    "a place of one more": (np.zeros(3), GOOD[1], r" cov: expected shape \(3, 3\), found \(2, 2\)"),
    "a column": (np.zeros((2, 1)), GOOD[1], " position: expected one dimension"),
    "a number as a place": (np.array(0.0), GOOD[1], " position: expected one dimension"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_mark_has_a_place_and_a_covariance(case):
    position, cov, message = BAD[case]
    with pytest.raises(ValueError, match=f"^mark M3{message}"):
        MarkMeasurement("M3", position, cov)


@pytest.mark.parametrize(
    ("shared", "found"),
    [
        (np.array([[NAN], [0.0]]), "finite numbers"),
        (np.array([[np.inf], [0.0]]), "finite numbers"),
        (np.zeros(2), r"2 rows, found \(2,\)"),
        (np.zeros((3, 1)), r"2 rows, found \(3, 1\)"),
    ],
)
def test_what_marks_share_is_finite_and_has_their_dimension(shared, found):
    with pytest.raises(ValueError, match=f"^mark M3 shared: expected {found}"):
        MarkMeasurement("M3", np.zeros(2), SD**2 * np.eye(2), shared)


def test_a_mark_stays_what_was_checked():
    """Its arrays are its own: the caller's may be used again for the next frame."""
    position, cov = np.zeros(2), SD**2 * np.eye(2)
    mark = MarkMeasurement("M3", position, cov)
    position[:], cov[:] = NAN, NAN
    assert np.isfinite(mark.position).all()
    with pytest.raises(ValueError, match="read-only"):
        mark.cov[0, 0] = -1.0


@pytest.mark.parametrize("case", BAD)
def test_a_fix_has_a_place_and_a_covariance(case, warmed):
    position, cov, message = BAD[case]
    if position.shape != (2,) or cov.shape != (2, 2):
        message = ": expected shapes"
    tissue = warmed(SD)
    before = digest(tissue.snapshot())
    with pytest.raises(ValueError, match=f"^fix{message}"):
        tissue.fix(position, cov)
    assert digest(tissue.snapshot()) == before


def sigma(phantom, rest_state, marks_of, own_m, shared_m, without=()):
    """Sigma of the target [m] after ten frames whose marks, but for those of `without`, share a shift."""
    frames = []
    for k in range(10):
        marks = [
            MarkMeasurement(
                m.node, m.position, own_m**2 * np.eye(2), None if m.node in without else shared_m * np.eye(2)
            )
            for m in marks_of(phantom, rest_state)
        ]
        frames.append((k / 30.0, marks))
    return float(np.sqrt(np.trace(followed(TissueFilter(phantom, HIDDEN, OUTER), frames)[-1].cov)))


def test_a_mark_that_shares_no_error_leaves_the_others_theirs(phantom, rest_state, marks_of):
    """A filter does not become more certain by as much as if none of the marks shared an error.

    One frame's R is that of the textbook, D + F F', with a row of zeros in F; sigma lies between all and none.
    """
    all_share, one_without, none_share = (
        sigma(phantom, rest_state, marks_of, 1e-4, 1e-3, without) for without in ((), ("M1",), OUTER)
    )
    assert none_share < one_without < all_share


def test_a_shift_that_all_marks_share_is_distinguished_from_motion_by_the_anchors(phantom, rest_state, marks_of):
    together = sigma(phantom, rest_state, marks_of, 1e-4, 4e-3)
    apart = sigma(phantom, rest_state, marks_of, np.hypot(4e-3, 1e-4), 0.0, OUTER)
    assert together**2 < 0.8 * apart**2


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
    """A known force that is not available from 0.1 s on: a third of the way is not gone either."""
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
