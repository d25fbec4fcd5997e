"""Sizes of the errors of three estimates, against draws of known ones and the textbook's best mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.filters.opinions import Scales, likeliest_scales

OWN = np.array([[1.0, 0.3], [0.3, 0.5]])
OTHER = np.diag([0.4, 0.8])


def drawn(n, scales, correlation, seed=0):
    """Distances of first and second from the third, of n places whose errors are drawn with these scales."""
    rng = np.random.default_rng(seed)
    common = correlation * np.sqrt(scales[0] * scales[1]) * OWN
    joint = np.block([[scales[0] * OWN, common], [common, scales[1] * OWN]])
    both = rng.multivariate_normal(np.zeros(4), joint, size=n)
    third = rng.multivariate_normal(np.zeros(2), scales[2] * OTHER, size=n)
    return both[:, :2] - third, both[:, 2:] - third


def found(n, scales, *, correlation=0.5, most=np.inf, seed=0):
    own, other = np.tile(OWN, (n, 1, 1)), np.tile(OTHER, (n, 1, 1))
    return likeliest_scales(drawn(n, scales, correlation, seed), own, other, most=most, correlation=correlation)


@pytest.mark.parametrize("scales", [(3.0, 2.0, 4.0), (1.5, 20.0, 2.0), (9.0, 1.2, 1.5)])
@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_scales_are_those_that_errors_were_drawn_with(scales, correlation):
    """Of 20,000 places; four standard errors of the least known of them, sqrt(2 / 20,000) a coordinate, are 8 %."""
    own = found(20_000, scales, correlation=correlation)
    np.testing.assert_allclose([own.first, own.second, own.third], scales, rtol=0.08)


def test_no_scale_is_below_one_and_the_first_is_no_larger_than_it_may_be():
    near = found(2_000, (0.1, 0.1, 0.1))
    assert (near.first, near.second, near.third) == (1.0, 1.0, 1.0)
    assert found(2_000, (9.0, 2.0, 2.0), most=4.0).first == 4.0


def test_an_outsider_is_told_of_by_the_other_two():
    """Twelve places, as many as a cloth has: the one that is far from both others is the one with the large errors."""
    for scales, worst in (((100.0, 1.0, 1.0), 0), ((1.0, 100.0, 1.0), 1), ((1.0, 1.0, 100.0), 2)):
        for seed in range(20):
            own = found(12, scales, seed=seed)
            assert np.argmax([own.first, own.second, own.third]) == worst


@given(st.floats(1.0, 1e3), st.floats(1.0, 1e3), st.floats(0.0, 0.9))
def test_the_share_is_that_of_least_variance_between_the_two(first, second, correlation):
    """Of all weights from 0 to 1, by brute force: of two correlated estimates of variances first and second."""
    scales = Scales(first, second)
    weights = np.linspace(0.0, 1.0, 2001)
    common = correlation * np.sqrt(first * second)
    variances = (1.0 - weights) ** 2 * first + weights**2 * second + 2.0 * weights * (1.0 - weights) * common
    share = scales.share_of_second(correlation)
    assert scales.of_mean(share, correlation) <= variances.min() * (1.0 + 1e-9)
    assert 0.0 <= share <= 1.0
    assert scales.of_mean(weights[300], correlation) == pytest.approx(variances[300])


def test_memory_is_linear_where_a_scale_has_a_bound_and_geometric_where_it_has_none():
    kept = Scales(4.0, 100.0, 1.0).remembered(Scales(2.0, 1.0, 16.0), 0.25)
    assert (kept.first, kept.second, kept.third) == pytest.approx((2.5, 100.0**0.25, 8.0))
