"""A mixture of two modes: considered columns, errors that change nothing, narrow sigma points. References by NumPy."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators import InteractingMixture, UnscentedKalmanFilter
from estimators.filters.mixture import NARROW, Move
from estimators.filters.unscented import CovarianceError

RATES = np.array([[-0.5, 0.5], [2.0, -2.0]])
MU = np.array([0.7, 0.3])
F = np.array([[1.0, 0.1], [0.0, 1.0]])
QS = [1e-3 * np.eye(2), np.eye(2)]
H, R = np.array([[1.0, 0.0]]), np.array([[0.05]])
BELIEF = (np.array([0.5, 0.0]), np.eye(2), np.array([[0.0], [0.4]]))


def mixture() -> InteractingMixture:
    """Two modes of a mass that moves freely for 0.1 s."""
    filters = []
    for Q in QS:
        f = UnscentedKalmanFilter(2, lambda s, _dt: s @ F.T)
        f.x, f.P, f.Q = np.zeros(2), np.eye(2), Q
        filters.append(f)
    made = InteractingMixture(filters, MU, RATES)
    made.columns = np.zeros((2, 2, 1))
    return made


def means(made: InteractingMixture) -> np.ndarray:
    return np.array([f.x for f in made.filters])


def test_a_restart_gives_every_mode_the_belief_and_keeps_their_odds():
    """Arrays of their own; of the whole, the covariance by P + C C'. Rounding."""
    made = mixture()
    made.mu = np.array([0.4, 0.6])
    made.restart(*BELIEF)
    np.testing.assert_allclose(made.mu, [0.4, 0.6], rtol=1e-14)
    np.testing.assert_array_equal(made.columns, [BELIEF[2]] * 2)
    np.testing.assert_allclose(made.P, BELIEF[1] + BELIEF[2] @ BELIEF[2].T, rtol=1e-14)
    for f in made.filters:
        f.x += 1.0
        f.P += 1.0
    np.testing.assert_array_equal(BELIEF[0], [0.5, 0.0])
    np.testing.assert_array_equal(BELIEF[1], np.eye(2))
    np.testing.assert_array_equal(made.filters[0].x, BELIEF[0] + 1.0)
    made.restart(*BELIEF)
    made.predict(0.1)
    np.testing.assert_allclose(made.x, F @ BELIEF[0], rtol=1e-14)


ERRORS = np.array([[[0.5, -0.2], [0.1, 0.4]], [[-0.3, 0.0], [0.6, 0.2]]])
COMMON = np.array([[0.4, -0.7]])


@pytest.mark.parametrize("considered", [True, False])
@pytest.mark.parametrize("shared", [None, COMMON, np.array([[0.4, 0.0]])])
def test_a_measurement_moves_columns_as_schmidts_filter_does(considered, shared):
    """Errors of each mode x - K y, so that columns become C - K (H C + F), P as Joseph's form has it for any gain.

    The gain is that of the joint covariance of state and innovation, where the columns are considered, errors common to
    all measurements counted twice, once as new ones (added_share 1); else Kalman's. Modes are weighed as if errors that
    do not move the measurement itself were known. By NumPy's inverse, to rounding.
    """
    made, z = mixture(), np.array([0.8])
    assert made.columns.shape == (2, 2, 1)
    assert (made.considered, made.added_share) == (True, 1.0)
    made.columns, made.considered = ERRORS.copy(), considered
    prior, densities, known = np.array([[0.1, 0.2], [0.3, -0.4]]), [], []
    for f, x in zip(made.filters, prior, strict=True):
        f.x = x
    F_b = np.zeros((1, 2)) if shared is None else shared
    made.update_linear(z, H, R, shared)
    for f, x, C, columns in zip(made.filters, prior, ERRORS, made.columns, strict=True):
        seen = C if considered else np.zeros_like(C)
        moved = H @ seen + (F_b if considered else 0.0)
        S = H @ H.T + moved @ moved.T + R + (F_b @ F_b.T if considered else 0.0)
        K = (H.T + seen @ moved.T) @ np.linalg.inv(S)
        kept = np.eye(2) - K @ H
        np.testing.assert_allclose(f.x, x + K @ (z - H @ x), rtol=1e-13)
        np.testing.assert_allclose(f.P, kept @ kept.T + K @ R @ K.T, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(columns, C - K @ (H @ C + F_b), rtol=1e-12, atol=1e-15)
        densities.append(multivariate_normal(H @ x, S).pdf(z))
        own = moved * (F_b != 0.0)
        known.append(multivariate_normal(H @ x, H @ H.T + own @ own.T + R).pdf(z))
    assert made.log_likelihood == pytest.approx(np.log(MU @ densities), rel=1e-12)
    np.testing.assert_allclose(made.mu, MU * known / (MU @ known), rtol=1e-12)
    np.testing.assert_allclose(made.innovation_columns, H @ ERRORS + F_b, rtol=1e-14)


def test_a_mixture_without_columns_considers_them_by_default():
    """None stand for its columns: (modes, n, 0)."""
    f = UnscentedKalmanFilter(2, lambda s, _dt: s)
    move = Move(lambda points, _dt: points)
    made = InteractingMixture([f, f], MU, RATES, move)
    assert made.move is move
    assert made.columns.shape == made.innovation_columns.shape == (2, 2, 0)
    assert made.considered
    assert made.N == 2


def test_a_covariance_that_is_no_number_is_an_error():
    with pytest.raises(
        CovarianceError, match=r"^mean and covariance of the mixture: expected finite, found otherwise$"
    ):
        mixture().restart(np.zeros(2), np.full((2, 2), np.nan))


def test_where_points_leave_the_models_ground_a_mode_moves_to_first_order():
    """Of x + x²/2, mean 1 and variance 4: 1.5 and (1 + 1)² 4, and without narrowing 1.5 + 4/2. Other modes as usual.

    By narrow points the variance has (1/2)² scale 4² NARROW² more, some 3 per cent of a per cent.
    """
    made = mixture()
    for f in made.filters:
        f.x, f.P, f.Q = np.array([1.0, 0.0]), np.diag([4.0, 1.0]), np.zeros((2, 2))
    made.chain.rates = np.zeros((2, 2))
    made.move = Move(lambda points, _dt: points + 0.5 * points**2, turned=lambda points: np.arange(len(points)) == 0)
    made.predict(0.1)
    assert made.repairs == {"narrowed": 1}
    assert made.filters[0].x[0] == pytest.approx(1.5, rel=1e-12)
    assert made.filters[0].P[0, 0] == pytest.approx(16.0, rel=NARROW**2)
    assert made.filters[1].x[0] == pytest.approx(3.5, rel=1e-12)
    made.predict(0.1)
    assert made.repairs == {"narrowed": 2}
    assert made.filters[0].x[0] == pytest.approx(1.5 + 0.5 * 1.5**2, rel=1e-12)


def test_narrow_points_spread_by_a_share_of_the_usual_ones():
    """Two modes of one belief, the first of which is narrowed: the points that are moved, to rounding."""
    made, moved = mixture(), []

    def kept(points: np.ndarray, _dt: float) -> np.ndarray:
        moved.append(points - points[:, :1])
        return points

    made.move = Move(kept, turned=lambda points: np.arange(len(points)) == 0)
    made.predict(0.1)
    narrow, usual = moved[0]
    np.testing.assert_allclose(narrow, NARROW * usual, rtol=1e-12, atol=1e-15)
    assert np.abs(usual).max() > 1.0


def test_an_innovation_that_is_no_number_changes_nothing():
    made = mixture()
    made.restart(*BELIEF)
    before, odds = means(made), made.mu
    with pytest.raises(CovarianceError, match=r"^innovation: expected a finite likelihood, found nan and -?\d"):
        made.update_linear(np.array([np.nan]), H, R)
    np.testing.assert_array_equal(means(made), before)
    np.testing.assert_array_equal(made.mu, odds)
