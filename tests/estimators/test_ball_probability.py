"""The probability of a ball against closed forms, other quadratures and draws."""

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.stats import chi, multivariate_normal, ncx2

from estimators import ball_probability


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("sd", [0.1, 1.0, 3.0, 40.0])
def test_about_its_centre_it_is_the_chi_distribution(dim, sd):
    """P(|e| <= r) of a round Gaussian, from much narrower to much wider than the ball: 1e-9."""
    found = ball_probability(np.zeros((1, dim)), sd**2 * np.eye(dim)[None], 2.0)[0]
    assert found == pytest.approx(chi(dim).cdf(2.0 / sd), rel=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_off_its_centre_it_is_the_noncentral_chi_square(dim):
    """Round Gaussians at twelve places, in and out of the ball: 1e-9."""
    rng = np.random.default_rng(2)
    offsets = rng.normal(size=(12, dim)) * rng.uniform(0.1, 4.0, (12, 1))
    found = ball_probability(offsets, np.tile(0.7**2 * np.eye(dim), (12, 1, 1)), 1.5)
    exact = ncx2((dim), (offsets**2).sum(axis=1) / 0.7**2).cdf((1.5 / 0.7) ** 2)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-9)


def test_long_ones_agree_with_another_quadrature():
    """Ellipses of eight to one, turned: SciPy's dblquad of the density over the disc, 1e-6."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    cov = turn @ np.diag([4.0, 0.0625]) @ turn.T
    offset = np.array([0.5, -0.3])
    density = multivariate_normal(offset, cov).pdf
    exact = dblquad(
        lambda y, x: density([x, y]), -1.0, 1.0, lambda x: -np.sqrt(1 - x * x), lambda x: np.sqrt(1 - x * x)
    )[0]
    assert ball_probability(offset[None], cov[None], 1.0)[0] == pytest.approx(exact, abs=1e-6)


def test_in_space_they_agree_with_draws():
    """A turned ellipsoid of 1 : 3 : 5, 400,000 draws: four standard errors, 0.003."""
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    cov = turn @ np.diag([0.04, 0.36, 1.0]) @ turn.T
    offset = np.array([0.4, -0.2, 0.3])
    drawn = rng.multivariate_normal(offset, cov, 400_000)
    share = (np.linalg.norm(drawn, axis=1) <= 1.0).mean()
    assert ball_probability(offset[None], cov[None], 1.0)[0] == pytest.approx(share, abs=0.003)


def test_what_has_no_probability_is_told():
    with pytest.raises(ValueError, match="positive definite"):
        ball_probability(np.zeros((1, 2)), np.zeros((1, 2, 2)), 1.0)
    with pytest.raises(ValueError, match="expected offsets"):
        ball_probability(np.zeros((1, 2)), np.zeros((1, 3, 3)), 1.0)
