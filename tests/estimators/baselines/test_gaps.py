"""Gaps of days cost the methods to compare with no more than what the filter forgets after."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER
from estimators import FilterSettings, MarkMeasurement, OpenLoop
from estimators.baselines.extended import ExtendedKalmanFilter

FORGET_S = FilterSettings().forget_s


def marks(phantom, by: float = 0.0):
    return [MarkMeasurement(node, phantom.positions[phantom.index(node)] + by, 1e-6 * np.eye(2)) for node in OUTER]


@pytest.mark.parametrize("gap_s", [6.0, 86_400.0])
def test_the_open_loop_goes_through_a_gap_as_through_five_seconds(phantom, gap_s):
    means = []
    for dt in (FORGET_S, gap_s):
        loop = OpenLoop(phantom, HIDDEN)
        loop.update(0.0, marks(phantom, 0.02))
        estimate = loop.update(dt, marks(phantom))
        assert estimate.time_s == dt
        means.append(estimate.mean)
    np.testing.assert_array_equal(*means)


def test_a_baseline_is_predicted_over_five_seconds_at_most(phantom, monkeypatch):
    method, moved = ExtendedKalmanFilter(phantom, HIDDEN, OUTER), []
    for k in range(3):
        method.predict(k / 30.0)
        method.update(marks(phantom))
    monkeypatch.setattr(method, "_advance", moved.append)
    method.predict(1.0)
    method.predict(1e9)
    assert moved == [pytest.approx(1.0 - 2.0 / 30.0), FORGET_S]
    assert method.time_s == 1e9
