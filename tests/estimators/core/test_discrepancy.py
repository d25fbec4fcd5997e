"""The discrepancy's field and its level, against conditional normal distributions and fields drawn at random."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dynamics import HIDDEN, OUTER, four_mass_phantom, rest_shape
from dynamics.elements import matern
from estimators import MarkMeasurement, TissueFilter
from estimators.core.discrepancy import Discrepancy, LevelPosterior, factor


def test_a_factor_keeps_the_most_of_the_variance() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6))
    cov = root @ root.T
    np.testing.assert_allclose(factor(cov, 6, 0.0) @ factor(cov, 6, 0.0).T, cov, atol=1e-12)
    two = factor(cov, 2)
    assert two.shape == (6, 2)
    assert np.linalg.norm(cov - two @ two.T, 2) == pytest.approx(np.sort(np.linalg.eigvalsh(cov))[-3], rel=1e-9)


def test_the_field_is_zero_where_the_body_is_held_and_whole_far_from_there() -> None:
    x = np.linspace(0.0, 1.0, 11)[:, None] * [1.0, 0.0]
    prior = Discrepancy()
    functions, _ = prior.field(x[1:], x[:1])
    sd = np.sqrt((functions**2).sum(axis=1))
    free, _ = prior.field(x, np.empty((0, 2)))
    np.testing.assert_allclose((free**2).sum(axis=1), 1.0 + prior.short**2, rtol=5e-3)
    assert np.all(np.diff(sd) > 0.0)
    assert sd[0] < 0.3 * sd[-1]
    functions, left_out = Discrepancy(loose=0.1).field(x, x[:1])
    variances = (functions**2).sum(axis=1) + left_out
    np.testing.assert_allclose(variances[0], 0.1 * (1.0 + prior.short**2), rtol=1e-4)
    np.testing.assert_allclose(variances[1:], 0.9 * sd**2 + 0.1 * (free[1:] ** 2).sum(axis=1), rtol=5e-3)


def test_functions_of_little_variance_are_kept_where_the_prior_asks_for_them() -> None:
    """Of 40 places on a line: the covariance is that of the definition to the least variance, by the largest."""
    x = np.linspace(0.0, 1.0, 40)[:, None]
    apart = np.abs(x - x.T)
    cov = matern(apart, 1.5) + 0.33**2 * matern(apart, 0.25)
    largest = np.linalg.eigvalsh(cov)[-1]
    errors, kept = {}, {}
    for least in (1e-3, 1e-5):
        functions, left_out = Discrepancy(least=least).field(x, np.empty((0, 1)))
        errors[least] = np.linalg.norm(cov - functions @ functions.T, 2) / largest
        kept[least] = functions.shape[1]
        assert errors[least] <= least
        np.testing.assert_allclose(left_out, (cov - functions @ functions.T).diagonal(), atol=1e-12)
    assert kept[1e-3] < kept[1e-5] <= 40
    assert errors[1e-3] > 1e-5


def test_levels_and_noises_are_weighed_by_how_each_mark_follows_from_those_outside_its_group() -> None:
    """Groups of different size, of two coordinates; the covariance of each pair from that of the present one."""
    rng, prior = np.random.default_rng(3), Discrepancy(weight=1.0)
    root, field = rng.normal(size=(2, 8, 8))
    R = np.diag(rng.uniform(0.5, 2.0, 8))
    S, fresh, y = root @ root.T + R, field @ field.T, rng.normal(size=8)
    groups = [np.array([[0, 1]]), np.array([[2, 3], [0, 1]]), np.array([[4, 5], [6, 7]])]
    posterior = LevelPosterior(prior)
    level, noise = posterior.level, posterior.noise
    assert noise**2 == pytest.approx(0.99 + 0.01 * 9.0)
    posterior.update(y, S, fresh, R, groups)
    expected = np.log([odds / 3.0 for _ in prior.levels for _, odds in prior.noises])
    for k, (other, (times, _)) in enumerate(product(prior.levels, prior.noises)):
        moved = S + (other**2 - level**2) * fresh + (times**2 / noise**2 - 1.0) * R
        for group in groups:
            own, others = group[0], np.setdiff1d(np.arange(8), group)
            gain = np.linalg.solve(moved[np.ix_(others, others)], moved[np.ix_(others, own)]).T
            cov = moved[np.ix_(own, own)] - gain @ moved[np.ix_(others, own)]
            expected[k] += multivariate_normal.logpdf(y[own], gain @ y[others], cov)
    np.testing.assert_allclose(posterior.log_weights, expected - np.logaddexp.reduce(expected), rtol=1e-9)


@pytest.mark.parametrize(("true", "noise"), [(0.003, 1.0), (0.01, 1.0), (0.03, 1.0), (0.01, 3.0)])
def test_the_level_and_the_noise_that_drew_the_marks_are_found(true: float, noise: float) -> None:
    """40 frames of 12 marks on a body of 0.1 m, stated to 0.1 mm."""
    rng, prior = np.random.default_rng(5), Discrepancy()
    places = rng.uniform(0.0, 0.1, (12, 1))
    functions, _ = prior.field(places, np.empty((0, 1)))
    posterior = LevelPosterior(prior)
    groups = [np.array([[k]]) for k in range(12)]
    for _ in range(40):
        y = true * functions @ rng.normal(size=functions.shape[1]) + noise * 1e-4 * rng.normal(size=12)
        fresh, R = functions @ functions.T, posterior.noise**2 * 1e-8 * np.eye(12)
        posterior.update(y, posterior.level**2 * fresh + R, fresh, R, groups)
        posterior.forget(1.0 / 30.0)
    assert posterior.level == pytest.approx(true, rel=0.15)
    assert posterior.noise == pytest.approx(noise, rel=0.1)


def test_without_marks_the_level_goes_back_to_its_prior() -> None:
    posterior = LevelPosterior(Discrepancy())
    usual = posterior.level
    posterior.log_weights = np.log(np.kron([0.98, 0.01, 0.01], [0.5, 0.5]))
    assert posterior.level < 0.5 * usual
    assert posterior.noise == pytest.approx(5.0**0.5)
    posterior.forget(120.0)
    assert posterior.noise == pytest.approx(1.04, abs=0.02)
    assert posterior.level == pytest.approx(usual, rel=0.1)
    assert usual**2 == pytest.approx(np.mean(np.square(Discrepancy().levels)))


def test_marks_after_a_fix_of_their_time_leave_levels_finite() -> None:
    """The fix has seen a part of what is new in the discrepancy since the frame before."""
    phantom = four_mass_phantom()
    tissue = TissueFilter(phantom, HIDDEN, OUTER)
    places = {node: phantom.positions[phantom.index(node)] for node in (*OUTER, HIDDEN)}
    for time_s in (0.0, 0.1, 0.2):
        tissue.predict(time_s)
        if time_s:
            tissue.fix(places[HIDDEN], 1e-6 * np.eye(2))
        tissue.update([MarkMeasurement(node, places[node], 1e-6 * np.eye(2)) for node in OUTER])
        assert np.isfinite(tissue.level.log_weights).all()


def test_marks_noisier_than_stated_are_recognised() -> None:
    """Phantom at rest, 1.5 s at 30 Hz, marks stated to 3 mm: the target's sigma is that of the true noise."""
    phantom, rng, sd_m, noise = four_mass_phantom(), np.random.default_rng(11), 3e-3, 3.0
    rest = rest_shape(phantom)
    stated, known = TissueFilter(phantom, HIDDEN, OUTER), TissueFilter(phantom, HIDDEN, OUTER)
    for k in range(45):
        errors = noise * sd_m * rng.normal(size=(len(OUTER), 2))
        found = []
        for tissue, times in ((stated, 1.0), (known, noise)):
            cov = (times * sd_m) ** 2 * np.eye(2)
            tissue.predict(k / 30.0)
            places = zip(OUTER, errors, strict=True)
            found.append(tissue.update([MarkMeasurement(n, rest[phantom.index(n)] + e, cov) for n, e in places]))
    assert found[0].noise == stated.level.noise == pytest.approx(noise, rel=0.05)
    np.testing.assert_allclose(*(np.sqrt(np.trace(one.cov)) for one in found), rtol=0.1)
    np.testing.assert_allclose(found[0].mean, found[1].mean, atol=0.2 * float(np.sqrt(found[1].cov[0, 0])))
