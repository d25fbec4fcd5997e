"""A body without anchors is followed by its marks. Truth: a rigid motion, by its closed form."""

import numpy as np

from dynamics import MassSpringNetwork
from estimators import MarkMeasurement, Status, TissueFilter, coverage, normalised_error_squared
from tests.estimators.conftest import followed
from tests.networks import build_network

SD, MARKED = 0.5e-3, ("a", "b", "c", "d")
CORNERS = 0.05 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
INSIDE = np.array([0.01, -0.005])


def square() -> MassSpringNetwork:
    """Four corners, one node inside, a spring between any two, as long as drawn."""
    springs = [(i, j) for i in range(5) for j in range(i)]
    constants = {"masses": 0.02, "drag": 0.01, "stiffness": 50.0, "damping": 0.5, "gravity": [0.0, -9.81]}
    return build_network(np.vstack([CORNERS, INSIDE]), springs, names=(*MARKED, "inside"), **constants)


def seen(places: np.ndarray) -> list[MarkMeasurement]:
    return [MarkMeasurement(node, at, SD**2 * np.eye(2)) for node, at in zip(MARKED, places, strict=True)]


def moved(places: np.ndarray, t: float) -> np.ndarray:
    """Moved about: some 0.1 m to and fro, turned by half a radian."""
    angle = 0.5 * np.sin(1.5 * t)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return places @ turn.T + 0.1 * np.array([np.sin(2.0 * t), 1.0 - np.cos(1.3 * t)])


def test_the_inside_follows_the_marks():
    """Two seconds at 30 frames/s, corners to 0.5 mm: under half a millimetre on average, and covered as claimed."""
    rng, times = np.random.default_rng(5), np.arange(60) / 30.0
    frames = [(t, seen(moved(CORNERS, t) + SD * rng.normal(size=(4, 2)))) for t in times]
    found = followed(TissueFilter(square(), "inside", MARKED), frames)
    errors = np.array([one.mean - moved(INSIDE[None], t)[0] for one, t in zip(found, times, strict=True)])
    assert found[-1].status is Status.TRACKING
    assert np.linalg.norm(errors[10:], axis=1).mean() < 0.5e-3
    assert coverage(normalised_error_squared(errors, [one.cov for one in found]), 2) > 0.9


def test_it_may_start_anywhere():
    """The first marks are a metre from where it is drawn, turned by two radians: it starts there within 0.7 s."""
    turn = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    frames = [(k / 30.0, seen(CORNERS @ turn.T + 1.0)) for k in range(25)]
    found = followed(TissueFilter(square(), "inside", MARKED), frames)
    np.testing.assert_allclose(found[-1].mean, turn @ INSIDE + 1.0, rtol=0, atol=1e-3)
