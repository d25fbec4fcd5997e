"""Rows of estimates.csv: order and units of docs/recording.md, written out."""

import numpy as np
import pytest

from estimators import Status, TargetEstimate
from experiments.formats.estimate_rows import header, row


def test_columns_in_the_plane_and_in_space():
    own = ["nis", "marks_used", "poked", "gain", "model_only"]
    assert header(2) == ["time_s", "status", "x_mm", "y_mm", "xx", "xy", "yy", *own]
    assert header(3) == ["time_s", "status", "x_mm", "y_mm", "z_mm", "xx", "xy", "yy", "xz", "yz", "zz", *own]


def test_every_number_stands_under_its_name():
    """Six different entries of a covariance, metres to mm and m² to mm²: exact to rounding."""
    cov = 1e-6 * np.array([[11.0, 12.0, 13.0], [12.0, 22.0, 23.0], [13.0, 23.0, 33.0]])
    given = {"nis": 4.5, "poked": 0.25, "gain": 0.75, "model_only": True}
    estimate = TargetEstimate(1.5, np.array([0.001, -0.002, 0.003]), cov, Status.TRACKING, marks_used=2, **given)
    named = dict(zip(header(3), row(estimate), strict=True))
    assert named.pop("status") == "TRACKING"
    expected = {"time_s": 1.5, "x_mm": 1.0, "y_mm": -2.0, "z_mm": 3.0, "marks_used": 2, **given}
    expected |= {"xx": 11.0, "xy": 12.0, "yy": 22.0, "xz": 13.0, "yz": 23.0, "zz": 33.0}
    assert named == pytest.approx(expected, rel=1e-12)


def test_what_a_method_does_not_say_is_none():
    estimate = TargetEstimate(0.0, np.array([0.1, 0.2]), None, Status.COASTING, marks_used=0)
    named = dict(zip(header(2), row(estimate), strict=True))
    assert [key for key, value in named.items() if value is None] == ["xx", "xy", "yy", "nis", "poked", "gain"]
    assert named["status"] == "COASTING"
