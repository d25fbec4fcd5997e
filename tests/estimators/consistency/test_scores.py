"""Scores against closed forms and integrals, transforms against what uniform means."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import kstest, norm

from estimators import crps_normal, energy_score, pit_normal


@pytest.mark.parametrize(("mean", "sd", "truth"), [(0.0, 1.0, 0.0), (1.0, 0.5, 2.0), (-3.0, 2.0, -10.0)])
def test_crps_is_the_integral_of_its_definition(mean, sd, truth):
    """CRPS = integral of (F(x) - 1[x >= truth])², by adaptive quadrature to 1e-10."""
    below = quad(lambda x: norm.cdf(x, mean, sd) ** 2, truth - 40.0, truth, limit=200, points=[mean])[0]
    above = quad(lambda x: norm.sf(x, mean, sd) ** 2, truth, truth + 40.0, limit=200, points=[mean])[0]
    assert crps_normal(mean, sd, truth) == pytest.approx(below + above, rel=1e-7)


def test_the_energy_score_of_a_hit_in_the_plane():
    """At the mean of N(0, 1) in the plane: E|X| = sqrt(pi / 2) and E|X - X'| = sqrt(pi). 200,000 draws: 5e-3."""
    score = energy_score(np.zeros((1, 2)), np.eye(2)[None], np.zeros((1, 2)), np.random.default_rng(1), 200_000)
    assert score[0] == pytest.approx(np.sqrt(np.pi / 2.0) - np.sqrt(np.pi) / 2.0, abs=5e-3)


def test_transforms_of_right_predictions_are_uniform():
    """Kolmogorov and Smirnov: p-values over 100 seeds are uniform themselves; under 5 % in 1 to 13 of them (99.9 %)."""
    low = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        means, sds = rng.normal(size=50), rng.uniform(0.1, 3.0, 50)
        low += kstest(pit_normal(means, sds, means + sds * rng.normal(size=50)), "uniform").pvalue < 0.05
    assert 1 <= low <= 13


def test_an_energy_score_of_one_draw_is_refused():
    with pytest.raises(ValueError, match="n_draws: expected 2 or more, found 1"):
        energy_score(np.zeros((1, 2)), np.eye(2)[None], np.zeros((1, 2)), np.random.default_rng(1), n_draws=1)
