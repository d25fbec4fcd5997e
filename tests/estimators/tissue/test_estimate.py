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


def test_status_is_written_as_its_word():
    assert [str(status) for status in Status] == ["INITIALISING", "TRACKING", "COASTING", "LOST", "DIVERGED"]


def test_what_a_method_does_not_tell_is_none():
    estimate = TargetEstimate(1.0, np.zeros(2), None, Status.LOST, 0)
    assert (estimate.nis, estimate.poked, estimate.cov) == (None, None, None)
    with pytest.raises(FrozenInstanceError):
        estimate.time_s = 2.0
