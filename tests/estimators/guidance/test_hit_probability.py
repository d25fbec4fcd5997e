"""The probability of a hit against closed forms, Imhof's integral and counting."""

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.stats import chi2, ncx2, norm, special_ortho_group

from estimators import Aim, GaussianMixture, Hit, Lesion, Needle, best_aim, hit_probability

TIP = Needle(hit=Hit.TIP)
NOWHERE = 1e-9
"""Standard deviation of a tip that is known [m]."""


MIDDLE, BALL = np.zeros(3), Lesion.ball(0.004, 3)


def of_tip(offset, cov, lesion, needle=TIP, axis=None):
    """Probability for a known tip at this offset [mm] from the target's mean, cov [mm²]."""
    dim = len(offset)
    axis = np.eye(dim)[0] if axis is None else axis
    tip = GaussianMixture.gaussian(1e-3 * np.asarray(offset), NOWHERE**2 * np.eye(dim))
    target = GaussianMixture.gaussian(np.zeros(dim), 1e-6 * np.asarray(cov))
    return hit_probability(target, tip, axis, lesion, needle=needle)


def turned_cov(sds, rng):
    """Covariance with these standard deviations, in a random direction."""
    V = special_ortho_group.rvs(len(sds), random_state=rng)
    return V @ np.diag(np.square(sds)) @ V.T


def imhof(offset, cov, radius):
    """P(|x|² <= radius²), x ~ N(offset, cov), by Imhof's one-dimensional integral, [imhof1961] (3.2), to 1e-6.

    Simpson's rule at steps of 0.001 to 400, of variances of 0.25 to 25: the rest oscillates and is less than 1e-6.
    """
    lam, V = np.linalg.eigh(cov)
    delta2 = (V.T @ offset) ** 2 / lam
    u = np.linspace(1e-9, 400.0, 400_001)[:, None]
    squared = (lam * u) ** 2
    theta = 0.5 * (np.arctan(lam * u) + delta2 * lam * u / (1 + squared)).sum(axis=1) - 0.5 * radius**2 * u[:, 0]
    log_rho = (0.25 * np.log1p(squared) + 0.5 * delta2 * squared / (1 + squared)).sum(axis=1)
    return 0.5 - simpson(np.sin(theta) / u[:, 0] * np.exp(-log_rho), x=u[:, 0]) / np.pi


@pytest.mark.parametrize("dim", [2, 3])
def test_a_round_gaussian_is_the_noncentral_chi_square(dim):
    """From a hundredth of the radius to thrice it, offsets from none to beyond the rim: SciPy's ncx2 to 1e-5."""
    rng = np.random.default_rng(0)
    for sd in (0.05, 0.2, 0.7, 2.0, 15.0):
        for k in range(8):
            offset = rng.normal(size=dim)
            offset *= min(k, 1) * rng.uniform(0, 5 + 2 * sd) / np.linalg.norm(offset)
            known = ncx2.cdf((5 / sd) ** 2, dim, offset @ offset / sd**2)
            assert of_tip(offset, sd**2 * np.eye(dim), Lesion.ball(5e-3, dim)) == pytest.approx(known, abs=1e-5)


@pytest.mark.parametrize("dim", [2, 3])
def test_any_covariance_against_imhofs_integral(dim):
    """Axis ratios to 10."""
    rng = np.random.default_rng(1)
    for _ in range(2):
        sds = np.exp(rng.uniform(np.log(0.5), np.log(5.0), size=dim))
        cov, offset = turned_cov(sds, rng), rng.normal(size=dim) * 2.0
        assert of_tip(offset, cov, Lesion.ball(4e-3, dim)) == pytest.approx(imhof(offset, cov, 4.0), abs=1e-5)


@pytest.mark.parametrize("dim", [2, 3])
def test_an_ellipsoid_is_a_ball_seen_through_a_linear_map(dim):
    """P(A z in the ellipsoid of A) = P(z in the ball), z ~ N(b, I): ncx2."""
    rng = np.random.default_rng(2)
    for _ in range(5):
        A = rng.normal(size=(dim, dim)) + 2 * np.eye(dim)
        b = rng.normal(size=dim)
        sd = 0.6
        got = of_tip(A @ b, sd**2 * A @ A.T, Lesion(1e-3 * A))
        assert got == pytest.approx(ncx2.cdf(1 / sd**2, dim, b @ b / sd**2), abs=1e-5)


def test_the_notch_lies_behind_the_tip():
    """Middle of a notch of 18 mm, 6 mm behind the tip: 15 mm back along the needle."""
    needle = Needle(hit=Hit.NOTCH, notch_offset_m=6e-3, notch_length_m=18e-3)
    axis = np.array([0.6, -0.8])
    at = of_tip(15.0 * axis, np.eye(2), Lesion.ball(2e-3, 2), needle, axis)
    assert at == pytest.approx(1 - np.exp(-2.0), abs=1e-5)
    assert of_tip(-15.0 * axis, np.eye(2), Lesion.ball(2e-3, 2), needle, axis) < 1e-6


@pytest.mark.parametrize(("dim", "power"), [(2, 1), (3, 2)])
def test_a_core_through_a_known_middle_is_a_matter_of_the_miss_across(dim, power):
    """The notch is long and its place along the needle known: chord >= L, that is across <= sqrt(r² - L²/4)."""
    needle = Needle(hit=Hit.CORE, notch_offset_m=0.0, notch_length_m=0.1, core_m=6e-3)
    axis = np.eye(dim)[-1]
    cov = np.diag([1.5**2] * (dim - 1) + [1e-8])
    got = of_tip(50.0 * axis, cov, Lesion.ball(5e-3, dim), needle, axis)
    across = np.sqrt(25.0 - 9.0) / 1.5
    assert got == pytest.approx(chi2.cdf(across**2, power), abs=1e-5)


def test_a_core_on_a_known_line_is_a_matter_of_the_depth():
    """No error across: overlap of the notch with the chord [-5, 5] mm is >= 4 where |depth error| <= 5 + 10 - 4."""
    needle = Needle(hit=Hit.CORE, notch_offset_m=0.0, notch_length_m=20e-3, core_m=4e-3)
    axis = np.array([0.0, 0.0, 1.0])
    got = of_tip(13.0 * axis, np.diag([1e-10, 1e-10, 25.0]), Lesion.ball(5e-3, 3), needle, axis)
    assert got == pytest.approx(norm.cdf(8.0 / 5) - norm.cdf(-14.0 / 5), abs=1e-5)


def test_no_core_is_longer_than_the_lesion():
    needle = Needle(hit=Hit.CORE, notch_length_m=20e-3, core_m=11e-3)
    assert of_tip([0, 0], np.eye(2), Lesion.ball(5e-3, 2), needle) == 0.0


CASES = {
    "ellipse, core": (Hit.CORE, np.array([[6.0, 2.0], [1.0, 3.0]])),
    "ball, notch": (Hit.NOTCH, 4.0 * np.eye(3)),
    "ellipsoid, core": (Hit.CORE, np.array([[6.0, 2.0, 0.0], [1.0, 3.0, 0.5], [0.0, 1.0, 4.0]])),
}


@pytest.mark.parametrize("name", CASES)
def test_against_counting_half_a_million(name):
    """Samples counted by the lesion's own geometry: 2e-3, three standard deviations of the count."""
    kind, axes = CASES[name]
    rng, dim = np.random.default_rng(5), len(axes)
    needle = Needle(hit=kind, notch_offset_m=5e-3, notch_length_m=8e-3, core_m=3e-3)
    axis = np.ones(dim) / np.sqrt(dim)
    target = GaussianMixture.gaussian(np.zeros(dim), 1e-6 * turned_cov(np.linspace(1.0, 2.0, dim), rng))
    middle = 1e-3 * rng.normal(size=dim)
    tip = GaussianMixture.gaussian(middle + needle.reach_m * axis, 1e-6 * turned_cov(np.linspace(0.3, 1.2, dim), rng))
    lesion = Lesion(1e-3 * axes)
    got = hit_probability(target, tip, axis, lesion, needle=needle)
    L = np.linalg.cholesky(target.covs[0] + tip.covs[0])
    n, hits = 500_000, 0
    for _ in range(4):
        offsets = middle + rng.standard_normal((n // 4, dim)) @ L.T
        if kind is Hit.CORE:
            hits += int((lesion.core_lengths(offsets, axis, 8e-3) >= 3e-3).sum())
        else:
            hits += int(lesion.contains(offsets).sum())
    assert 0.1 < got < 0.95
    assert abs(got - hits / n) < 2e-3


def test_a_single_gaussian_is_aimed_at_in_its_middle():
    """And no aim 1 mm beside it is better."""
    rng = np.random.default_rng(6)
    axis, lesion = np.array([0.0, 0.6, 0.8]), Lesion(1e-3 * np.diag([3.0, 4.0, 5.0]))
    needle = Needle(hit=Hit.CORE)
    mean, cov, tip_cov = rng.normal(size=3), 1e-6 * turned_cov([1.0, 2.0, 3.0], rng), 1e-6 * np.eye(3)
    aim = best_aim(GaussianMixture.gaussian(mean, cov), tip_cov, axis, lesion, needle=needle)
    np.testing.assert_array_equal(aim.point, mean)
    for way in np.vstack([np.eye(3), -np.eye(3)]):
        tip = GaussianMixture.gaussian(mean + 1e-3 * way + needle.reach_m * axis, tip_cov)
        beside = hit_probability(GaussianMixture.gaussian(mean, cov), tip, axis, lesion, needle=needle)
        assert beside < aim.probability - 1e-4


def scanned(target, tip_cov, lesion) -> Aim:
    """The best aim of a grid of 0.1 mm over the plane."""
    xs = 1e-3 * np.arange(-8, 8.05, 0.1)
    best = Aim(np.zeros(2), -1.0)
    for x in xs:
        for y in 1e-3 * np.arange(-1, 1.05, 0.5):
            p = hit_probability(
                target, GaussianMixture.gaussian(np.array([x, y]), tip_cov), np.array([1.0, 0.0]), lesion, needle=TIP
            )
            best = max(best, Aim(np.array([x, y]), p), key=lambda aim: aim.probability)
    return best


@pytest.mark.parametrize("apart_mm", [1.5, 6.0])
def test_of_two_places_the_likelier_one_or_between(apart_mm):
    """Two Gaussians, 0.6 and 0.4: near by, between them; far apart, at the likelier. Against a scan, to its step."""
    target = GaussianMixture(
        np.array([0.6, 0.4]), 1e-3 * np.array([[-apart_mm, 0.0], [apart_mm, 0.0]]), np.tile(1e-6 * np.eye(2), (2, 1, 1))
    )
    lesion, tip_cov = Lesion.ball(2.5e-3, 2), 0.04e-6 * np.eye(2)
    aim = best_aim(target, tip_cov, np.array([1.0, 0.0]), lesion, needle=TIP)
    known = scanned(target, tip_cov, lesion)
    assert aim.probability >= known.probability - 1e-6
    np.testing.assert_allclose(aim.point, known.point, rtol=0, atol=0.1e-3)
    assert (aim.point[0] < -5e-3) == (apart_mm == 6.0)


def test_the_likeliest_of_three_places_is_found_though_the_mean_is_nearer_another():
    """0.3 at -9 mm, 0.3 at -3, 0.4 at 12: their mean is 1.2 mm, and uphill from there lies the one at -3."""
    places = 1e-3 * np.array([[-9.0, 0.0], [-3.0, 0.0], [12.0, 0.0]])
    target = GaussianMixture(np.array([0.3, 0.3, 0.4]), places, np.tile(0.5e-6 * np.eye(2), (3, 1, 1)))
    aim = best_aim(target, 0.5e-6 * np.eye(2), np.array([1.0, 0.0]), Lesion.ball(2.5e-3, 2), needle=TIP)
    np.testing.assert_allclose(aim.point, places[2], rtol=0, atol=0.05e-3)
    assert aim.probability == pytest.approx(0.4 * (1 - np.exp(-(2.5**2) / 2)), abs=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Lesion.ball(0.0, 2), "lesion radius: expected more than 0 m, found 0.0"),
        (lambda: Lesion(np.ones((2, 2))), "lesion axes: expected finite ones that span 2 dimensions"),
        (lambda: Lesion(np.ones(3)), "lesion axes: expected shape"),
        (lambda: Needle(tip_sd_m=-1.0), "needle tip_sd_m: expected 0 or more, found -1.0"),
        (lambda: Needle(notch_length_m=0.0), "needle notch_length_m: expected more than 0"),
        (lambda: Needle(hit=Hit.CORE, core_m=0.03), "needle core_m: expected no more than notch_length_m"),
        (
            lambda: GaussianMixture(np.array([0.5, 0.4]), np.zeros((2, 2)), np.zeros((2, 2, 2))),
            "mixture weights: expected",
        ),
        (lambda: of_tip([0, 0, 0], np.eye(3), Lesion.ball(1.0, 2)), "dimensions: expected target, tip and axis of"),
        (lambda: of_tip(MIDDLE, np.eye(3), BALL, axis=MIDDLE), "axis: expected a finite non-zero vector"),
        (lambda: of_tip(MIDDLE, np.eye(3), BALL, axis=np.full(3, np.nan)), "axis: expected a finite non-zero vector"),
        (lambda: of_tip(np.full(3, np.nan), np.eye(3), BALL), "tip: expected finite means"),
        (lambda: of_tip(MIDDLE, -np.eye(3), BALL), "target: expected finite means and valid covariances"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_an_estimate_is_no_mixture():
    tip = GaussianMixture.gaussian(np.zeros(2), np.eye(2))
    with pytest.raises(TypeError, match=r"target: expected a GaussianMixture, .* found ndarray"):
        hit_probability(np.zeros(2), tip, np.array([1.0, 0.0]), Lesion.ball(1.0, 2))


def test_a_sure_hit_is_no_more_than_certain():
    """A case whose sums came to 1 + 4e-8."""
    cov = np.array([[1.8102169434260163e-06, -5.982736874948036e-08], [-5.982736874948037e-08, 1.5650777512215573e-06]])
    target = GaussianMixture.gaussian(np.zeros(2), 0.5 * cov)
    tip = GaussianMixture.gaussian(np.array([-5.0761272201476065e-05, -2.2215894317195728e-05]), 0.5 * cov)
    axis, lesion = np.array([-0.55485502, -0.83194706]), Lesion.ball(0.008118140344103266, 2)
    assert 1.0 - 1e-6 < hit_probability(target, tip, axis, lesion, needle=TIP) <= 1.0
