"""What goes into a filter and what comes out is checked and fixed."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from estimators import MarkMeasurement, Status, TargetEstimate


@pytest.mark.parametrize("dim", [2, 3])
def test_a_mark_is_a_position_and_its_covariance(dim):
    mark = MarkMeasurement("M1", np.ones(dim), np.eye(dim))
    assert mark.node == "M1"
    with pytest.raises(FrozenInstanceError):
        mark.node = "M2"


@pytest.mark.parametrize("cov", [np.eye(3), np.ones(2), np.array(1.0), np.ones((1, 2))])
def test_a_covariance_of_another_shape_is_refused(cov):
    with pytest.raises(ValueError, match=r"mark M1 cov: expected shape \(2, 2\), found"):
        MarkMeasurement("M1", np.zeros(2), cov)


@pytest.mark.parametrize(
    ("position", "cov"),
    [
        (np.array([np.nan, 0.0]), np.eye(2)),
        (np.array([0.0, np.inf]), np.eye(2)),
        (np.zeros(2), np.full((2, 2), np.nan)),
    ],
)
def test_a_mark_that_was_not_seen_is_absent_and_never_nan(position, cov):
    """Style, rule 18."""
    with pytest.raises(ValueError, match="mark M1: expected finite numbers"):
        MarkMeasurement("M1", position, cov)


def test_status_is_written_as_its_word():
    assert [str(status) for status in Status] == ["INITIALISING", "TRACKING", "COASTING", "LOST", "DIVERGED"]


def test_what_a_method_does_not_tell_is_none():
    estimate = TargetEstimate(1.0, np.zeros(2), None, Status.LOST, 0)
    assert (estimate.nis, estimate.poked, estimate.cov) == (None, None, None)
    with pytest.raises(FrozenInstanceError):
        estimate.time_s = 2.0
