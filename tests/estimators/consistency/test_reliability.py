"""Predicted probabilities against what came of them."""

import numpy as np
import pytest
from scipy.stats import binom

from estimators import clopper_pearson, reliability_bins


@pytest.mark.parametrize(("hits", "n"), [(1, 10), (5, 10), (37, 40), (200, 1000)])
def test_the_interval_is_where_each_tail_is_half_a_per_cent(hits, n):
    """Clopper and Pearson's definition, with the binomial distribution itself."""
    least, most = clopper_pearson(hits, n)
    assert binom.sf(hits - 1, n, least) == pytest.approx(0.005)
    assert binom.cdf(hits, n, most) == pytest.approx(0.005)


def test_none_and_all_leave_one_side_open():
    assert clopper_pearson(0, 0) == (0.0, 1.0)
    assert clopper_pearson(0, 20) == (0.0, pytest.approx(1 - 0.005 ** (1 / 20)))
    assert clopper_pearson(20, 20) == (pytest.approx(0.005 ** (1 / 20)), 1.0)


def test_tenths_hold_their_lower_edge_and_the_last_one_holds_one():
    rows = reliability_bins([0.0, 0.05, 0.1, 0.3, 0.9, 1.0], [0, 1, 0, 1, 1, 1])
    assert [(row.n, row.hits) for row in rows] == [(2, 1), (1, 0), (0, 0), (1, 1), *[(0, 0)] * 5, (2, 2)]
    assert [row.low for row in rows] == pytest.approx(np.arange(10) / 10)
    assert rows[0].mean == pytest.approx(0.025)
    assert rows[2].mean is None
    assert rows[2].inside


def test_what_is_true_is_inside_and_what_is_too_sure_is_not():
    """20,000 draws: hits with the probability predicted; then with 0.1 less."""
    rng = np.random.default_rng(0)
    p = rng.uniform(size=20_000)
    assert all(row.inside for row in reliability_bins(p, rng.uniform(size=20_000) < p))
    off = reliability_bins(p, rng.uniform(size=20_000) < p - 0.1)
    assert not any(row.inside for row in off[1:])
    assert sum(row.n for row in off) == 20_000


@pytest.mark.parametrize(
    ("p", "hit", "message"),
    [([0.5], [1, 0], "expected as many hits as predictions"), ([1.5], [1], "from 0 to 1"), ([np.nan], [1], "from 0")],
)
def test_no_probabilities_are_refused(p, hit, message):
    with pytest.raises(ValueError, match=message):
        reliability_bins(p, hit)
