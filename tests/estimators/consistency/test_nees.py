"""Chi-square figures against printed tables, coverage against drawn samples."""

import numpy as np
import pytest

from estimators import anees, chi_square_bounds, coverage, mean_bounds, normalised_error_squared

# Printed tables (Abramowitz and Stegun, 26.8): upper points of chi-square, five figures.
TABLE = {1: (0.00098207, 5.02389), 2: (0.0506356, 7.37776), 6: (1.237344, 14.4494), 100: (74.2219, 129.561)}


@pytest.mark.parametrize("degrees", TABLE)
def test_bounds_are_the_tables(degrees):
    """2.5 % and 97.5 % points of the table, to the figures printed."""
    np.testing.assert_allclose(chi_square_bounds(degrees), TABLE[degrees], rtol=1e-5)


def test_bounds_hold_the_share_that_is_asked_for():
    """Two degrees are exponential: P(q < x) = 1 - exp(-x / 2), so the bounds are -2 log of the tails. Rounding."""
    for share in (0.5, 0.9, 0.99):
        tail = (1.0 - share) / 2.0
        assert chi_square_bounds(2, share) == pytest.approx((-2 * np.log1p(-tail), -2 * np.log(tail)), rel=1e-12)


def test_bounds_of_a_mean_are_those_of_the_sum():
    """Sum of 50 variables of two degrees is one of 100: the table's 74.22 and 129.56, over 50."""
    np.testing.assert_allclose(mean_bounds(2, 50), np.array(TABLE[100]) / 50.0, rtol=1e-5)


@pytest.mark.parametrize(("degrees", "inside", "outside"), [(2, 5.991, 5.992), (1, 3.841, 3.842), (3, 7.814, 7.815)])
def test_coverage_counts_up_to_the_tables_95_percent_point(degrees, inside, outside):
    """Table: 3.8415, 5.9915, 7.8147 for one, two, three degrees."""
    assert coverage([inside, outside, inside, inside], degrees) == 0.75


@pytest.mark.parametrize(
    ("degrees", "share", "message"),
    [
        (2, 95, "share: expected more than 0 and less than 1, found 95"),
        (2, 0.0, "share: expected"),
        (0, 0.95, "degrees: expected more than 0, found 0"),
    ],
)
def test_shares_in_percent_and_no_degrees_are_refused(degrees, share, message):
    for function in (lambda: coverage([1.0], degrees, share), lambda: mean_bounds(degrees, 5, share)):
        with pytest.raises(ValueError, match=message):
            function()


def test_normalised_squared_is_the_quadratic_form():
    """(3, 4) with variances 9 and 4 is 1 + 4; with covariance [[2, 1], [1, 2]] (1, 1) gives 2/3. Rounding."""
    covs = [np.diag([9.0, 4.0]), np.array([[2.0, 1.0], [1.0, 2.0]])]
    np.testing.assert_allclose(normalised_error_squared([[3.0, 4.0], [1.0, 1.0]], covs), [5.0, 2.0 / 3.0], rtol=1e-14)


@pytest.mark.parametrize("cov", [np.ones((2, 2)), np.diag([1.0, -1.0])])
def test_a_covariance_that_is_not_positive_definite_is_an_error(cov):
    with pytest.raises(np.linalg.LinAlgError):
        normalised_error_squared([[1.0, 1.0]], [cov])


def test_anees_is_one_where_the_covariance_is_right():
    """Mean of chi-square of d degrees is d. 30,000 draws: 3 sqrt(2 / 3 / 30,000)."""
    squared = np.random.default_rng(8).chisquare(3, size=(300, 100))
    assert anees(squared, 3) == pytest.approx(1.0, abs=0.015)
