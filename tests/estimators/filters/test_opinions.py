"""Sizes of the errors of three estimates, against draws of known ones and the textbook's best mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.filters.opinions import Scales, likeliest_scales

OWN = np.array([[1.0, 0.3], [0.3, 0.5]])
OTHER = np.diag([0.4, 0.8])


def drawn(n, scales, seed=0):
    """Distances of first and second from the third, of n places whose errors are drawn with these scales."""
    rng = np.random.default_rng(seed)
    first, second = (rng.multivariate_normal(np.zeros(2), scale * OWN, size=n) for scale in scales[:2])
    third = rng.multivariate_normal(np.zeros(2), scales[2] * OTHER, size=n)
    return first - third, second - third


def found(n, scales, *, seed=0, **beside):
    own, other = np.tile(OWN, (n, 1, 1)), np.tile(OTHER, (n, 1, 1))
    return likeliest_scales(drawn(n, scales, seed), own, other, **beside)


@pytest.mark.parametrize("scales", [(3.0, 2.0, 4.0), (1.5, 20.0, 2.0), (9.0, 1.2, 1.5)])
def test_scales_are_those_that_errors_were_drawn_with(scales):
    """Of 20,000 places; four standard errors of the least known of them, sqrt(2 / 20,000) a coordinate, are 8 %."""
    own = found(20_000, scales)
    np.testing.assert_allclose([own.first, own.second, own.third], scales, rtol=0.08)


def test_no_scale_is_below_one_and_the_first_is_no_larger_than_it_may_be():
    near = found(2_000, (0.1, 0.1, 0.1))
    assert (near.first, near.second, near.third) == (1.0, 1.0, 1.0)
    assert found(2_000, (9.0, 2.0, 2.0), most=4.0).first == 4.0


def test_the_second_may_err_less_than_the_covariance_that_it_shares_where_that_is_said():
    """Of 20,000 places, to the same 8 %; no less than it may be, and no less than 1 where nothing is said."""
    scales = (3.0, 0.2, 2.0)
    assert found(20_000, scales, least=0.05).second == pytest.approx(0.2, rel=0.08)
    assert found(20_000, scales, least=0.4).second == 0.4
    assert found(20_000, scales).second == 1.0


def test_what_is_known_of_the_third_weighs_as_so_many_coordinates():
    """The mode is between what the distances say and what was known.

    First and second have covariances of nearly nought. Then the log posterior of s, the third's scale, by 2 k
    coordinates of squared sum Q is -Q / 2 s - k log s - known / 2 (log s)²: its derivative is nought at the mode.
    """
    k, known = 20, 15.0
    apart = np.full((k, 2), 4.0)
    tiny, other = np.tile(1e-6 * OWN, (k, 1, 1)), np.tile(np.eye(2), (k, 1, 1))
    s = likeliest_scales((apart, apart), tiny, other, known=known).third
    # distances of both are those of the third alone, 2 k coordinates; the last step is below a thousandth of log s
    information = k + known
    assert 0.5 * (apart**2).sum() / s - k - known * np.log(s) == pytest.approx(0.0, abs=4e-3 * information)
    free = likeliest_scales((apart, apart), tiny, other).third
    assert free == pytest.approx(16.0, rel=0.01)
    assert 1.0 < s < 0.7 * free


def test_an_outsider_is_told_of_by_the_other_two():
    """Twelve places, as many as a cloth has: the one that is far from both others is the one with the large errors."""
    for scales, worst in (((100.0, 1.0, 1.0), 0), ((1.0, 100.0, 1.0), 1), ((1.0, 1.0, 100.0), 2)):
        for seed in range(20):
            own = found(12, scales, seed=seed)
            assert np.argmax([own.first, own.second, own.third]) == worst


@given(st.floats(1e-2, 1e3), st.floats(1e-2, 1e3))
def test_the_share_is_that_of_least_variance_between_the_two(first, second):
    """Of all weights from 0 to 1, by brute force: of two independent estimates of variances first and second."""
    scales = Scales(first, second)
    weights = np.linspace(0.0, 1.0, 2001)
    variances = (1.0 - weights) ** 2 * first + weights**2 * second
    assert scales.of_mean <= variances.min() * (1.0 + 1e-9)
    assert 0.0 <= scales.share_of_second <= 1.0
    share = scales.share_of_second
    assert scales.of_mean == pytest.approx((1.0 - share) ** 2 * first + share**2 * second)


def test_memory_is_linear_where_a_scale_has_a_bound_and_geometric_where_it_has_none():
    kept = Scales(4.0, 100.0, 1.0).remembered(Scales(2.0, 1.0, 16.0), 0.25)
    assert (kept.first, kept.second, kept.third) == pytest.approx((2.5, 100.0**0.25, 8.0))
