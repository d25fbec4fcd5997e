"""Links that turn within an elbow, against the closed form of a four-bar linkage: where two circles meet."""

import numpy as np
import pytest

from estimators.process.mechanism import angle_between, turned, turnings
from tests.estimators.tissue.test_turning_elbows import LENGTHS, links

END = np.array([0.06, -0.12])
ROWS = np.arange(4)


def shape(angle: float) -> np.ndarray:
    """First and second joint, (2, 2), with the first link at this angle from straight down and the end where it is.

    The second joint is where the circles about the first and the end meet, on the right of the way to the end.
    """
    first = LENGTHS[0] * np.array([np.sin(angle), -np.cos(angle)])
    way = END - first
    distance = np.linalg.norm(way)
    along = (LENGTHS[1] ** 2 - LENGTHS[2] ** 2 + distance**2) / (2.0 * distance)
    across = np.sqrt(LENGTHS[1] ** 2 - along**2)
    return np.array([first, first + (along * way + across * np.array([way[1], -way[0]])) / distance])


def state(angle: float, rate: float = 0.0) -> np.ndarray:
    """Places and velocities of joints and end where the first link turns at this rate [rad/s], the end at rest."""
    e = 1e-6
    speed = rate * (shape(angle + e) - shape(angle - e)) / (2.0 * e)
    return np.r_[shape(angle).ravel(), END, speed.ravel(), 0.0, 0.0]


def link_angles(place: np.ndarray) -> np.ndarray:
    links = np.diff(np.vstack([np.zeros(2), place.reshape(-1, 2)]), axis=0)
    return np.arctan2(links[:, 0], -links[:, 1])


def test_the_only_way_to_turn_is_that_of_the_linkage():
    """By differences of the closed form, its fastest link by 1 rad: 1e-7, their error."""
    e, x = 1e-5, state(0.4)
    (way,) = turnings(links(), ROWS, x)
    expected = (state(0.4 + e) - state(0.4 - e))[:6]
    rates = link_angles(state(0.4 + e)[:6]) - link_angles(state(0.4 - e)[:6])
    expected = expected / np.abs(rates).max()
    np.testing.assert_allclose(way[:6] * np.sign(way[0] * expected[0]), expected, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(way[6:], 0.0)


@pytest.mark.parametrize("angle", [-0.6, -0.2, 0.3, 0.5])
def test_a_belief_goes_round_the_linkage(angle):
    """Its fastest link by the angle; mean, speed and a spread along the way are those of the closed form there.

    To 10 % of the angle, for steps of 0.1 rad go straight on; to 0.05 mm, and 1 % of speed and spread.
    """
    network, x = links(), state(0.4, 2.0)
    (way,) = turnings(network, ROWS, x)
    columns = way[:, None]
    mean, cov, moved = turned(network, ROWS, (x, 1e-4 * columns @ columns.T, columns), angle * way)
    own = float(np.arctan2(mean[0], -mean[1]))
    fastest = np.abs(link_angles(mean[:6]) - link_angles(x[:6])).max()
    assert fastest == pytest.approx(abs(angle), rel=0.1)
    assert angle_between(network, x, mean) == pytest.approx(fastest, abs=1e-9)
    np.testing.assert_allclose(mean[:6], state(own)[:6], rtol=0, atol=5e-5)
    tangent = state(own, 1.0)[6:12]
    speed = mean[6:12] @ tangent / (tangent @ tangent)
    np.testing.assert_allclose(mean[6:12], speed * tangent, rtol=0, atol=0.01 * np.abs(speed * tangent).max())
    spread = moved[:6, 0] @ tangent / (tangent @ tangent)
    np.testing.assert_allclose(moved[:6, 0], spread * tangent, rtol=0, atol=0.01 * np.abs(spread * tangent).max())
    np.testing.assert_allclose(cov, 1e-4 * moved @ moved.T, rtol=0, atol=1e-16)


def test_there_and_back_is_where_it_was():
    """To the error of the length of its steps, 1 of 26 mm."""
    network, x = links(), state(0.4, 2.0)
    (way,) = turnings(network, ROWS, x)
    there, cov, columns = turned(network, ROWS, (x, np.eye(12), np.eye(12)), 0.3 * way)
    (back,) = turnings(network, ROWS, there)
    again, _, _ = turned(network, ROWS, (there, cov, columns), -0.3 * np.sign(back @ way) * back)
    np.testing.assert_allclose(again[:6], x[:6], rtol=0, atol=1e-3)
    assert np.abs(there[:6] - x[:6]).max() > 0.01


def lengths_and_rates(x: np.ndarray) -> np.ndarray:
    """Of the three links [m], [m/s], (6,)."""
    links, speeds = (np.diff(np.vstack([np.zeros(2), part.reshape(3, 2)]), axis=0) for part in (x[:6], x[6:]))
    lengths = np.linalg.norm(links, axis=1)
    return np.r_[lengths, (links * speeds).sum(axis=1) / lengths]


def test_what_is_known_of_lengths_and_rates_turns_along():
    """Of errors in any direction, by central differences: to 1 %, for ends are let move a little to stay solvable."""
    network, x, e = links(), state(0.4, 2.0), 1e-5
    (way,) = turnings(network, ROWS, x)
    columns = np.random.default_rng(0).normal(size=(12, 12))
    mean, _, moved = turned(network, ROWS, (x, np.eye(12), columns), 0.3 * way)
    for own, there in zip(columns.T, moved.T, strict=True):
        before = (lengths_and_rates(x + e * own) - lengths_and_rates(x - e * own)) / (2.0 * e)
        after = (lengths_and_rates(mean + e * there) - lengths_and_rates(mean - e * there)) / (2.0 * e)
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-2 * np.abs(before).max())
