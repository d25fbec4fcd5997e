"""Registration by points against known motions, SciPy, the equations of Fitzpatrick, and the scatter of many fits."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from estimators import Registration, RegistrationError, RigidMotion, register_points, weighted_mean, without_each

N_POINTS, TARGET = 7, {2: np.array([[0.02, 0.01]]), 3: np.array([[0.02, 0.01, -0.03]])}


def turn(dim: int, angles: tuple[float, float, float]) -> np.ndarray:
    about = (0.0, 0.0, angles[2]) if dim == 2 else angles
    return Rotation.from_rotvec(about).as_matrix()[:dim, :dim]


def body(dim: int, n: int = N_POINTS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a body of 200 mm, and anisotropic covariances: 0.5 mm along a direction of its own, 2 mm across."""
    rng = np.random.default_rng(dim)
    along = rng.normal(size=(n, dim))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    covs = 4e-6 * np.eye(dim) - 3.75e-6 * np.einsum("ki,kj->kij", along, along)
    return rng.uniform(-0.1, 0.1, (n, dim)), covs, np.linalg.cholesky(covs)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("angles", [(0.3, -0.2, 0.5), (1.5, 2.0, 3.0), (0.0, 0.0, 0.0)])
def test_a_known_motion_is_found(dim: int, angles: tuple[float, float, float]) -> None:
    drawn, covs, _ = body(dim)
    R, t = turn(dim, angles), np.array([0.4, -1.2, 0.7])[:dim]
    for k in (dim, N_POINTS):
        found = register_points(drawn[:k], drawn[:k] @ R.T + t, covs[:k])
        np.testing.assert_allclose(found.motion.rotation, R, atol=1e-12)
        np.testing.assert_allclose(found.motion.moved(TARGET[dim]), TARGET[dim] @ R.T + t, atol=1e-12)
        assert found.rms_m < 1e-12
        assert found.degrees == k * dim - dim * (dim + 1) // 2


def test_with_alike_covariances_the_rotation_is_scipys() -> None:
    rng = np.random.default_rng(1)
    drawn = body(3)[0]
    measured = drawn @ turn(3, (0.3, -0.2, 0.5)).T + 0.01 * rng.normal(size=drawn.shape)
    found = register_points(drawn, measured, np.tile(1e-4 * np.eye(3), (N_POINTS, 1, 1)))
    scipys = Rotation.align_vectors(measured - measured.mean(axis=0), drawn - drawn.mean(axis=0))[0]
    np.testing.assert_allclose(found.motion.rotation, scipys.as_matrix(), atol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("exchanged", [False, True], ids=["noise", "exchanged"])
def test_it_is_the_most_probable_motion(dim: int, exchanged: bool) -> None:
    """As a search without derivatives finds it, also where two points have exchanged names."""
    drawn, covs, factors = body(dim)
    measured = drawn + np.einsum("kij,kj->ki", factors, np.random.default_rng(2).normal(size=drawn.shape))
    if exchanged:
        measured[[0, 1]] = measured[[1, 0]]
    found = register_points(drawn, measured, covs)

    def chi_square(change: np.ndarray) -> float:
        r = measured - found.motion.changed(change).moved(drawn)
        return float(np.einsum("ki,kij,kj->", r, np.linalg.inv(covs), r))

    n = dim * (dim + 1) // 2
    best = minimize(chi_square, np.full(n, 1e-2), method="Powell", options={"xtol": 1e-10, "ftol": 1e-14})
    assert found.chi_square == pytest.approx(chi_square(np.zeros(n)), rel=1e-12)
    assert found.chi_square <= best.fun * (1.0 + 1e-9)
    np.testing.assert_allclose(found.p_value, chi2.sf(found.chi_square, N_POINTS * dim - n), rtol=1e-12)


def test_expected_errors_are_those_of_fitzpatrick() -> None:
    """Mean squared FRE (1 - 2/N) FLE², TRE² FLE²/N (1 + sum of d²/f² / 3): equal isotropic errors, principal axes."""
    drawn, fle = body(3)[0], 1e-3 * np.sqrt(3.0)
    found = register_points(drawn, drawn, np.tile(1e-6 * np.eye(3), (N_POINTS, 1, 1)))
    assert found.expected_rms_m == pytest.approx(np.sqrt(1.0 - 2.0 / N_POINTS) * fle, rel=1e-9)
    about = drawn - drawn.mean(axis=0)
    axes = np.linalg.svd(about)[2]
    apart, target = about @ axes.T, (TARGET[3][0] - drawn.mean(axis=0)) @ axes.T
    ratios = [
        (target @ target - target[k] ** 2) / np.mean(np.sum(apart**2, axis=1) - apart[:, k] ** 2) for k in range(3)
    ]
    tre = np.sqrt(fle**2 / N_POINTS * (1.0 + sum(ratios) / 3.0))
    assert np.sqrt(np.trace(found.error_cov(TARGET[3])[0])) == pytest.approx(tre, rel=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_covariances_are_those_of_many_fits(dim: int) -> None:
    """Whitened errors of 250 fits scatter as unit normal ones: variances to 0.3, three times their own scatter."""
    n_fits, (drawn, covs, factors) = 250, body(dim)
    true = RigidMotion(turn(dim, (0.3, -0.2, 0.5)), np.array([0.4, -1.2, 0.7])[:dim], np.zeros(dim))
    fits = [
        register_points(drawn, true.moved(drawn) + np.einsum("kij,kj->ki", factors, noise), covs)
        for noise in np.random.default_rng(3).normal(size=(n_fits, *drawn.shape))
    ]
    centred = RigidMotion(
        true.rotation, true.moved(fits[0].motion.centre[None])[0] - fits[0].motion.centre, fits[0].motion.centre
    )
    changes = [centred.change_to(fit.motion) for fit in fits]
    targets = [(fit.motion.moved(TARGET[dim]) - true.moved(TARGET[dim]))[0] for fit in fits]
    residuals = [fit.residuals[0] for fit in fits]
    for errors, cov in (
        (changes, fits[0].cov),
        (targets, fits[0].error_cov(TARGET[dim])[0]),
        (residuals, fits[0].residual_covs[0]),
    ):
        white = np.linalg.solve(np.linalg.cholesky(cov), np.array(errors).T)
        np.testing.assert_allclose(white @ white.T / n_fits, np.eye(len(cov)), atol=0.3)
    degrees = fits[0].degrees
    assert np.mean([fit.chi_square for fit in fits]) == pytest.approx(
        degrees, abs=4.0 * np.sqrt(2.0 * degrees / n_fits)
    )


def test_a_wrong_point_shows_in_the_chi_square_and_is_found_by_leaving_it_out() -> None:
    drawn, covs, _ = body(3)
    measured = drawn.copy()
    measured[4] += [0.0, 0.02, 0.0]
    found = register_points(drawn, measured, covs)
    assert found.p_value < 1e-6
    others = without_each(drawn, measured, covs)
    left = [one.chi_square for one in others if one is not None]
    assert np.argmin(left) == 4
    assert isinstance(others[4], Registration)
    np.testing.assert_allclose(others[4].motion.moved(drawn), drawn, atol=1e-9)


def test_few_points_leave_none_out() -> None:
    drawn, covs, _ = body(3)
    assert without_each(drawn[:3], drawn[:3], covs[:3]) == (None, None, None)


@pytest.mark.parametrize(
    ("drawn", "found"),
    [
        (np.zeros((1, 2)), "2 or more points far from each other, found 1$"),
        (np.array([[0.0, 0.0], [2e-3, 0.0]]), "found 2 that leave the turn uncertain by 0.71 rad"),
        (np.eye(3)[:2], "3 or more points far from one line, found 2$"),
        (np.outer(np.arange(4.0), [0.1, 0.2, 0.3]), "found 4 measured on one line"),
        (
            np.array([[0.0, 0.0, 0.0], [0.1, 1e-3, 0.0], [0.2, 0.0, 0.0]]),
            "found 3 that leave the turn uncertain by 1.2 rad",
        ),
    ],
)
def test_points_that_do_not_determine_the_motion_are_refused(drawn: np.ndarray, found: str) -> None:
    covs = np.tile(1e-6 * np.eye(drawn.shape[1]), (len(drawn), 1, 1))
    with pytest.raises(RegistrationError, match=f"expected .*{found}"):
        register_points(drawn, drawn, covs)


@pytest.mark.parametrize(
    ("dim", "spread", "found"),
    [(2, 0.0, "7 measured at one place"), (3, 0.0, "7 measured on"), (3, 1.0, "on one line")],
)
def test_points_measured_at_one_place_are_refused(dim: int, spread: float, found: str) -> None:
    drawn, covs, _ = body(dim)
    measured = np.full((N_POINTS, dim), 0.1) + spread * drawn[:, :1]
    with pytest.raises(RegistrationError, match=f"expected {dim} or more points far from .*, found .*{found}"):
        register_points(drawn, measured, covs)


def test_a_weighted_mean_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(5)
    places, (_, covs, factors) = rng.normal(size=(N_POINTS, 3)), body(3)
    white = np.linalg.inv(factors)
    stacked = white.reshape(-1, 3)
    expected = np.linalg.lstsq(stacked, np.einsum("kij,kj->ki", white, places).ravel(), rcond=None)[0]
    mean, cov = weighted_mean(places, covs)
    np.testing.assert_allclose(mean, expected, atol=1e-12)
    np.testing.assert_allclose(cov, np.linalg.inv(stacked.T @ stacked), rtol=1e-9)


@pytest.mark.parametrize(
    ("measured", "covs", "message"),
    [
        (
            np.zeros((3, 3)),
            np.zeros((4, 3, 3)),
            r"points: expected shapes .*, found \(\(4, 3\), \(3, 3\), \(4, 3, 3\)\)",
        ),
        (np.zeros((4, 3)), np.eye(3), r"points: expected shapes .*, found \(\(4, 3\), \(4, 3\), \(3, 3\)\)"),
        (np.full((4, 3), np.nan), np.tile(np.eye(3), (4, 1, 1)), "points: expected finite numbers, found others"),
    ],
)
def test_points_of_other_shapes_or_without_numbers_are_refused(
    measured: np.ndarray, covs: np.ndarray, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        register_points(np.vstack([np.zeros(3), np.eye(3)]), measured, covs)
