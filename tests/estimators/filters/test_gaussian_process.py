"""The field through noisy values, against the joint normal distribution that it stands for."""

import numpy as np
import pytest

from estimators.filters.gaussian_process import Field, matern

PLACES = np.array([0.0, 0.11, 0.23, 0.35, 0.42, 0.57, 0.68, 0.81, 0.9, 1.0])
SEEN = [0, 1, 3, 5, 6, 8, 9]


def field_on(places: np.ndarray, length: float) -> Field:
    distances = np.abs(places[:, None] - places) / length
    return Field(matern(distances), np.column_stack([np.ones(len(places)), places]))


def test_matern_is_the_correlation_of_its_class() -> None:
    """Equation (4.14) with nu = 5/2, by the Bessel function of its definition."""
    from scipy.special import gamma, kv

    r, nu = np.array([0.05, 0.3, 1.0, 2.5]), 2.5
    scaled = np.sqrt(2.0 * nu) * r
    np.testing.assert_allclose(matern(r), 2.0 ** (1.0 - nu) / gamma(nu) * scaled**nu * kv(nu, scaled), rtol=1e-12)
    assert matern(np.zeros(1))[0] == 1.0


def test_mean_and_covariance_are_those_of_the_joint_distribution() -> None:
    """A trend of unknown slopes is a prior without bounds: here of 1e4, conditioned on the values at once."""
    field, rng = field_on(PLACES, 0.4), np.random.default_rng(3)
    noise = np.array([0.0, 1e-3, 2e-3, 1e-3, 3e-3, 1e-3, 0.0])
    values = rng.normal(size=(7, 2)) + PLACES[SEEN, None]
    mean, cov = field.through(SEEN, values, noise)  # type: ignore[misc]
    free = [k for k in range(len(PLACES)) if k not in SEEN]
    alone = field.correlation - field.correlation[:, SEEN] @ np.linalg.solve(
        field.correlation[np.ix_(SEEN, SEEN)], field.correlation[SEEN]
    )
    variance = cov[free[0], free[0]]
    assert variance > 0.0
    assert alone[free[0], free[0]] > 0.0
    # the field's variance is one number: take it from one entry of the exact expression, then all others must agree
    for s2 in np.geomspace(1e-3, 1e3, 4001):
        prior = s2 * field.correlation + 1e4 * field.trend @ field.trend.T
        S = prior[np.ix_(SEEN, SEEN)] + np.diag(noise)
        gain = np.linalg.solve(S, prior[SEEN]).T
        exact_cov = prior - gain @ prior[SEEN]
        if exact_cov[free[0], free[0]] >= variance:
            break
    np.testing.assert_allclose(cov[np.ix_(free, free)], exact_cov[np.ix_(free, free)], rtol=0.02, atol=1e-3 * variance)
    np.testing.assert_allclose(mean[free], (gain @ values)[free], atol=0.02 * np.abs(values).max())


def test_what_is_linear_is_followed_exactly() -> None:
    field = field_on(PLACES, 0.4)
    line = np.column_stack([3.0 - 2.0 * PLACES, 0.5 * PLACES])
    mean, _ = field.through(SEEN, line[SEEN], np.full(7, 1e-8))  # type: ignore[misc]
    np.testing.assert_allclose(mean, line, atol=1e-6)


def test_its_variance_is_found_from_the_values() -> None:
    """400 fields drawn from the class: of those not seen, 95 % lie within 1.96 standard deviations, at any size."""
    field, rng = field_on(PLACES, 0.4), np.random.default_rng(4)
    root = np.linalg.cholesky(field.correlation + 1e-12 * np.eye(10))
    inside = []
    for size in np.geomspace(1e-3, 1e3, 400):
        truth = size * root @ rng.normal(size=(10, 3)) + PLACES[:, None] * size
        seen = truth[SEEN] + 0.02 * size * rng.normal(size=(7, 3))
        mean, cov = field.through(SEEN, seen, np.full(7, (0.02 * size) ** 2))  # type: ignore[misc]
        hidden = [2, 4, 7]
        sd = np.sqrt(np.diag(cov)[hidden])[:, None]
        inside.append(np.abs(truth[hidden] - mean[hidden]) < 1.96 * sd)
    # the variance is known from seven places in three axes: coverage of Student's kind, a few points below 95 %
    assert 0.89 <= np.mean(inside) <= 0.97


@pytest.mark.parametrize("places", [[0, 1, 3], [0, 0, 0, 0, 0]])
def test_too_little_or_nothing_apart_tells_of_no_field(places: list[int]) -> None:
    field = field_on(PLACES, 0.4)
    assert field.through(places, np.zeros((len(places), 2)), np.full(len(places), 1e-6)) is None
