"""A body without anchors is followed by its marks. Truth: a rigid motion, by its closed form."""

from dataclasses import replace

import numpy as np

from dynamics import MassSpringNetwork, rest_shape
from estimators import MarkMeasurement, Status, TissueFilter

SD = 0.5e-3
CORNERS = 0.05 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
INSIDE = np.array([0.01, -0.005])


def square() -> MassSpringNetwork:
    """Four corners, one node inside, a spring between any two, as long as drawn."""
    positions = np.vstack([CORNERS, INSIDE])
    springs = np.array([(i, j) for i in range(5) for j in range(i)])
    lengths = np.linalg.norm(positions[springs[:, 0]] - positions[springs[:, 1]], axis=1)
    return MassSpringNetwork(
        names=("a", "b", "c", "d", "inside"),
        positions=positions,
        masses=np.full(5, 0.02),
        fixed=np.zeros(5, dtype=bool),
        drag=np.full(5, 0.01),
        friction=np.zeros(5),
        springs=springs,
        stiffness=np.full(10, 50.0),
        rest_lengths=lengths,
        damping=np.full(10, 0.5),
        gravity=np.array([0.0, -9.81]),
    )


def moved(places: np.ndarray, t: float) -> np.ndarray:
    """Carried about by a hand: some 0.1 m to and fro, turned by half a radian."""
    angle = 0.5 * np.sin(1.5 * t)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return places @ turn.T + 0.1 * np.array([np.sin(2.0 * t), 1.0 - np.cos(1.3 * t)])


def test_it_rests_where_it_is_drawn_and_turned():
    """Without anchors there is no weight, and no shape but its own, wherever it is drawn."""
    network = square()
    turned = moved(network.positions, 0.7)
    np.testing.assert_allclose(rest_shape(replace(network, positions=turned)), turned, rtol=0, atol=1e-9)
    pulled = replace(network, positions=turned * [1.2, 1.0])
    lengths = np.linalg.norm(np.diff(rest_shape(pulled)[network.springs], axis=1)[:, 0], axis=1)
    np.testing.assert_allclose(lengths, network.rest_lengths, rtol=1e-6)


def test_the_inside_follows_the_marks():
    """Six seconds at 30 frames/s, corners to 0.5 mm: under half a millimetre on average, and covered as claimed."""
    rng, network = np.random.default_rng(5), square()
    tissue = TissueFilter(network, "inside", ("a", "b", "c", "d"))
    errors, covered = [], []
    for k in range(180):
        tissue.predict(k / 30.0)
        seen = moved(CORNERS, k / 30.0) + SD * rng.normal(size=(4, 2))
        marks = [MarkMeasurement(node, at, SD**2 * np.eye(2)) for node, at in zip("abcd", seen, strict=True)]
        estimate = tissue.update(marks)
        error = estimate.mean - moved(INSIDE[None], k / 30.0)[0]
        errors.append(np.linalg.norm(error))
        covered.append(error @ np.linalg.solve(estimate.cov, error) < 5.99)
    assert estimate.status is Status.TRACKING
    assert np.mean(errors[10:]) < 0.5e-3
    assert np.mean(covered) > 0.9


def test_it_may_start_anywhere():
    """The first marks are a metre from where it is drawn, turned by two radians: it starts there within 0.7 s."""
    network = square()
    turn = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    tissue = TissueFilter(network, "inside", ("a", "b", "c", "d"))
    for k in range(25):
        tissue.predict(k / 30.0)
        marks = [MarkMeasurement(n, turn @ at + 1.0, SD**2 * np.eye(2)) for n, at in zip("abcd", CORNERS, strict=True)]
        estimate = tissue.update(marks)
    np.testing.assert_allclose(estimate.mean, turn @ INSIDE + 1.0, rtol=0, atol=1e-3)
