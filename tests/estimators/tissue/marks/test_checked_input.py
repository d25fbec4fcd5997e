"""Input that cannot be a measurement: one clear ValueError, and the filter as it was."""

import numpy as np
import pytest

from estimators import MarkMeasurement
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
    "variances alone": (GOOD[0], np.ones(2), r" cov: expected shape \(2, 2\), found \(2,\)"),
    "another dimension": (GOOD[0], SD**2 * np.eye(3), r" cov: expected shape \(2, 2\), found \(3, 3\)"),
    "no place": (np.array([NAN, 0.0]), GOOD[1], ": expected finite numbers"),
    "a place of one more": (np.zeros(3), GOOD[1], r" cov: expected shape \(3, 3\), found \(2, 2\)"),
    "a column": (np.zeros((2, 1)), GOOD[1], " position: expected one dimension"),
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
