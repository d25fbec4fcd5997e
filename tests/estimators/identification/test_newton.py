"""The minimum of functions of which it is known: quadratic, rough, with walls."""

import numpy as np
import pytest

from estimators.identification.newton import minimum

PLACE, CURVATURE = np.array([-1.2, 0.4, 0.03]), np.array([20.0, 90.0, 4000.0])
LEAST = np.full(3, 2.0)


class Counted:
    """A function that keeps the places at which it was asked for."""

    def __init__(self, of):
        self.of, self.places = of, []

    def __call__(self, x):
        self.places.append(x)
        return self.of(x)


def bowl(x):
    return 3.0 + 0.5 * float(CURVATURE @ (x - PLACE) ** 2)


def test_a_quadratic_is_solved_in_two_steps():
    """Differences of a quadratic are exact; a variable moves by 1 at most, then comes the rest."""
    cost = Counted(bowl)
    found = minimum(cost, np.zeros(3), LEAST, tolerance=0.1)
    np.testing.assert_allclose(found.x, PLACE, atol=1e-9)
    np.testing.assert_allclose(found.curvature, CURVATURE, rtol=1e-6)
    assert found.value == pytest.approx(3.0, abs=1e-9)
    assert len(cost.places) <= 22
    assert np.abs(cost.places[7]).max() == pytest.approx(1.0)


def test_of_variables_that_go_together_the_rest_is_below_the_tolerance():
    """Correlated by 0.6: steps along the axes close in on it."""
    H = np.diag(np.sqrt(CURVATURE)) @ np.array([[1, 0.6, 0], [0.6, 1, 0], [0, 0, 1]]) @ np.diag(np.sqrt(CURVATURE))
    found = minimum(lambda x: 0.5 * (x - PLACE) @ H @ (x - PLACE), np.zeros(3), LEAST, tolerance=0.1)
    assert found.value < 0.1


def test_roughness_below_the_tolerance_does_not_keep_it_going():
    rng = np.random.default_rng(0)
    cost = Counted(lambda x: bowl(x) + rng.normal(0.0, 0.2))
    found = minimum(cost, np.zeros(3), LEAST, tolerance=1.0)
    assert len(cost.places) < 40
    assert bowl(found.x) < 3.0 + 1.0


def test_steps_that_bring_less_than_they_promise_end_the_search():
    """Forty functions rough by twice the tolerance: 21.7 places each; 24.1 where a search ends by promises alone."""
    n_places, above = [], []
    for seed in range(40):

        def rough(x, seed=seed):
            cell = np.floor(x * 1e3).astype(np.int64).view(np.uint64)
            return bowl(x) + np.random.default_rng([seed, *cell.tolist()]).uniform(-2.0, 2.0)

        cost = Counted(rough)
        above.append(bowl(minimum(cost, np.zeros(3), LEAST, tolerance=1.0).x) - 3.0)
        n_places.append(len(cost.places))
    assert np.mean(n_places) < 23.0
    assert np.mean(above) < 1.0


def test_what_is_known_of_the_curvature_sets_the_first_steps():
    """Two standard errors: 0.3 at most, 0.05 at least."""
    cost = Counted(bowl)
    minimum(cost, PLACE, LEAST, tolerance=1.0, curvature=np.array([1.0, 100.0, 1e6]))
    np.testing.assert_allclose(np.diag(cost.places[1:4] - PLACE), [0.3, 0.2, 0.05])


def test_a_wall_is_walked_away_from_and_a_flat_direction_has_the_least_curvature():
    cost = Counted(lambda x: np.inf if x[0] > 0.1 else 0.5 * float(20.0 * (x[0] + 0.5) ** 2))
    found = minimum(cost, np.zeros(2), LEAST[:2], tolerance=0.01)
    assert found.x[0] == pytest.approx(-0.5, abs=0.05)
    assert found.curvature[1] == pytest.approx(2.0)


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_from_where_it_is_not_finite_there_is_no_step(value):
    cost = Counted(lambda _x: value)
    found = minimum(cost, PLACE, LEAST, tolerance=0.1)
    assert len(cost.places) == 1
    np.testing.assert_array_equal(found.x, PLACE)
    np.testing.assert_array_equal(found.curvature, LEAST)
