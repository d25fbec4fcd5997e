"""A body without anchors is followed by its marks. Truth: a rigid motion, by its closed form."""

import numpy as np
import pytest

from estimators import MarkMeasurement, TissueFilter
from tests.estimators.conftest import followed
from tests.networks import build_network

PLACES = 0.05 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [0.2, -0.1]])


def seen(moved):
    """Estimates of 25 frames of a square whose corners are seen at these places, (4, 2); N4 is hidden inside."""
    springs = [(i, j) for i in range(5) for j in range(i)]
    constants = {"masses": 0.02, "drag": 0.01, "stiffness": 50.0, "damping": 0.5, "gravity": [0.0, -9.81]}
    square = build_network(PLACES, springs, **constants)
    marked = square.names[:4]
    marks = [MarkMeasurement(name, at, 2.5e-7 * np.eye(2)) for name, at in zip(marked, moved, strict=True)]
    return followed(TissueFilter(square, "N4", marked), [(k / 30.0, marks) for k in range(25)])


@pytest.mark.parametrize("away_m", [1.0, 100.0])
def test_it_may_start_anywhere(away_m):
    """The first marks are far from where it is drawn, turned by two radians: it starts there within 0.7 s."""
    turn = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    moved = PLACES @ turn.T + away_m
    np.testing.assert_allclose(seen(moved[:4])[-1].mean, moved[4], rtol=0, atol=1e-3)
