"""Thresholds of advice: what a record accepts, its defaults, and `health_fault` from either side of every bound."""

from dataclasses import replace

import numpy as np
import pytest

from estimators import AdviceSettings, Status, TargetEstimate, health_fault

HEALTHY = TargetEstimate(8.0, np.array([0.0, 0.04]), 1e-6 * np.eye(2), Status.TRACKING, 3)
EXACT = AdviceSettings(stale_s=0.125, coasting_s=0.25)
"""Bounds that differences of times reach without rounding."""


def test_defaults():
    expected = (0.9, 0.05, 2.0, 0.1, 0.1, 0.2, 1.0, 1e-3, 0.5, 0.5)
    assert AdviceSettings() == AdviceSettings(*expected)


@pytest.mark.parametrize(
    ("name", "accepted", "rejected"),
    [
        ("go", (1e-9, 0.5, 1.0), (0.0, -0.1, 1.0 + 1e-9, np.nan)),
        ("worth", (0.0, 0.5, 1.0), (-1e-9, 1.0 + 1e-9, np.nan)),
        ("abort", (0.0, 0.5, 1.0), (-1e-9, 1.0 + 1e-9, np.nan)),
        ("abort_s", (0.0, 10.0), (-1e-9, np.inf, np.nan)),
        ("step_s", (1e-9, 10.0), (0.0, -0.1, np.inf, np.nan)),
        ("needle_s", (1e-9, 10.0), (0.0, -0.1, np.inf, np.nan)),
        ("stale_s", (1e-9, 10.0), (0.0, -0.1, np.inf, np.nan)),
        ("horizon_s", (0.0, 10.0), (-1e-9, np.inf, np.nan)),
        ("coasting_s", (0.0, 10.0), (-1e-9, np.inf, np.nan)),
        ("overshot_m", (0.0, 10.0), (-1e-9, np.inf, np.nan)),
    ],
)
def test_the_range_of_each_setting(name, accepted, rejected):
    for value in accepted:
        assert getattr(AdviceSettings(**{name: value}), name) == value
    for value in rejected:
        with pytest.raises(ValueError, match=rf"advice .*{name}.*: expected"):
            AdviceSettings(**{name: value})


@pytest.mark.parametrize("status", Status)
def test_guidance_needs_a_status_of_tracking_or_coasting(status):
    fault = health_fault(replace(HEALTHY, status=status), 8.0, 8.0, EXACT)
    assert fault == (None if status in (Status.TRACKING, Status.COASTING) else f"the estimate is {status}")


def test_an_estimate_may_be_as_old_as_the_bound():
    assert health_fault(HEALTHY, 8.125, 8.125, EXACT) is None
    assert health_fault(HEALTHY, 8.126, 8.126, EXACT) == "the estimate is 0.13 s old, more than 0.125 s"
    assert (
        health_fault(replace(HEALTHY, time_s=np.nan), 8.0, 8.0, EXACT) == "the estimate is nan s old, more than 0.125 s"
    )


def test_marks_may_be_unseen_for_as_long_as_the_bound():
    assert health_fault(HEALTHY, 8.0, 7.75, EXACT) is None
    assert health_fault(HEALTHY, 8.0, 7.74, EXACT) == "no mark was seen for 0.26 s, more than 0.25 s"
    assert health_fault(HEALTHY, 8.0, None, EXACT) == "no mark was seen for inf s, more than 0.25 s"


def test_one_number_that_is_not_finite_is_enough():
    """Of the mean or of the covariance, infinite or no number."""
    for bad in (np.nan, np.inf):
        cov = HEALTHY.cov.copy()
        cov[1, 1] = bad
        for broken in (replace(HEALTHY, mean=np.array([0.0, bad])), replace(HEALTHY, cov=cov)):
            assert health_fault(broken, 8.0, 8.0, EXACT) == "the estimate is not finite"
    assert health_fault(replace(HEALTHY, cov=None), 8.0, 8.0, EXACT) == "the estimate has no covariance"


def test_the_first_fault_is_stated():
    """Status before age, age before covariance, covariance before marks, marks before the model."""
    broken = replace(HEALTHY, status=Status.LOST, cov=None, model_only=True)
    order = [
        (broken, 9.0, None, "the estimate is LOST"),
        (replace(broken, status=Status.TRACKING), 9.0, None, "the estimate is 1.00 s old"),
        (replace(broken, status=Status.TRACKING), 8.0, None, "the estimate has no covariance"),
        (replace(HEALTHY, model_only=True), 8.0, None, "no mark was seen"),
        (replace(HEALTHY, model_only=True), 8.0, 8.0, "the marks contain almost no information"),
    ]
    for estimate, now_s, seen_s, reason in order:
        assert health_fault(estimate, now_s, seen_s, EXACT).startswith(reason)
