"""Branches of a mixture: beliefs side by side, each by all modes, against mixtures that are run alone."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from estimators import InteractingMixture, UnscentedKalmanFilter
from estimators.filters.branches import prune
from estimators.filters.mixture import NARROW, Move
from estimators.filters.unscented import CovarianceError

RATES = np.array([[-0.5, 0.5], [2.0, -2.0]])
MU = np.array([0.7, 0.3])
F = np.array([[1.0, 0.1], [0.0, 1.0]])
QS = [1e-3 * np.eye(2), np.eye(2)]
H, R = np.array([[1.0, 0.0]]), np.array([[0.05]])
LEFT = (np.array([-1.0, 0.2]), np.array([[0.5, 0.1], [0.1, 0.3]]), np.array([[0.1], [0.2]]))
RIGHT = (np.array([2.0, -0.1]), np.array([[0.2, 0.0], [0.0, 0.9]]), np.array([[-0.3], [0.0]]))
MIDDLE = (np.array([0.5, 0.0]), np.eye(2), np.array([[0.0], [0.4]]))


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


def branched(
    *beliefs: tuple[np.ndarray, np.ndarray, np.ndarray], odds: Sequence[float], made: InteractingMixture | None = None
) -> InteractingMixture:
    made = mixture() if made is None else made
    made.branch(beliefs, np.array(odds))
    return made


def means(made: InteractingMixture) -> np.ndarray:
    return np.array([f.x for f in made.filters])


def covs(made: InteractingMixture) -> np.ndarray:
    return np.array([f.P for f in made.filters])


def test_each_branch_has_its_belief_in_every_mode_and_the_odds_of_now():
    """Odds of branch times mode; of the whole, mean and covariance by total variance of P + C C'. Rounding."""
    made = branched(LEFT, RIGHT, odds=[3.0, 1.0])
    assert made.n_branches == 2
    assert made.repairs == {"branched": 1}
    np.testing.assert_allclose(made.mu, [0.525, 0.225, 0.175, 0.075], rtol=1e-14)
    np.testing.assert_allclose(made.branch_odds, [0.75, 0.25], rtol=1e-14)
    np.testing.assert_allclose(made.mode_odds, MU, rtol=1e-14)
    for k, (mean, cov, columns) in enumerate((LEFT, LEFT, RIGHT, RIGHT)):
        np.testing.assert_array_equal(made.filters[k].x, mean)
        np.testing.assert_array_equal(made.filters[k].P, cov)
        np.testing.assert_array_equal(made.columns[k], columns)
        np.testing.assert_array_equal(made.filters[k].Q, QS[k % 2])
    apart, (left, right) = LEFT[0] - RIGHT[0], (P + C @ C.T for _, P, C in (LEFT, RIGHT))
    np.testing.assert_allclose(made.x, 0.75 * LEFT[0] + 0.25 * RIGHT[0], rtol=1e-14)
    np.testing.assert_allclose(made.P, 0.75 * left + 0.25 * right + 0.1875 * np.outer(apart, apart), rtol=1e-13)


def test_branches_share_no_array_with_each_other_or_what_they_came_from():
    made = branched(LEFT, RIGHT, odds=[0.5, 0.5])
    for f in made.filters:
        f.x += 1.0
        f.P += 1.0
    np.testing.assert_array_equal(LEFT[0], [-1.0, 0.2])
    np.testing.assert_array_equal(LEFT[1], [[0.5, 0.1], [0.1, 0.3]])
    np.testing.assert_array_equal(made.filters[0].x, made.filters[1].x)
    np.testing.assert_array_equal(made.filters[1].P, LEFT[1] + 1.0)


def test_branching_again_counts_the_new_ones_and_keeps_the_modes_odds():
    """From two branches to three, modes' odds summed over those there were."""
    made = branched(LEFT, RIGHT, odds=[0.5, 0.5])
    made.mu = np.array([0.1, 0.2, 0.3, 0.4])
    branched(LEFT, RIGHT, MIDDLE, odds=[0.2, 0.3, 0.5], made=made)
    assert made.n_branches == 3
    assert made.repairs == {"branched": 3}
    np.testing.assert_allclose(made.mode_odds, [0.4, 0.6], rtol=1e-14)
    np.testing.assert_allclose(made.branch_odds, [0.2, 0.3, 0.5], rtol=1e-14)


@pytest.mark.parametrize("dt", [0.1, 0.7])
def test_branches_move_as_mixtures_alone(dt):
    """Modes mix within a branch only, so that its odds stay as they are. Rounding."""
    made = branched(LEFT, RIGHT, odds=[0.8, 0.2])
    made.predict(dt)
    alone = [branched(one, odds=[1.0]) for one in (LEFT, RIGHT)]
    for other in alone:
        other.predict(dt)
    np.testing.assert_allclose(means(made), np.vstack([means(one) for one in alone]), rtol=1e-13)
    np.testing.assert_allclose(covs(made), np.vstack([covs(one) for one in alone]), rtol=1e-13)
    np.testing.assert_allclose(made.branch_odds, [0.8, 0.2], rtol=1e-13)
    np.testing.assert_allclose(made.mode_odds, MU @ expm(RATES * dt), rtol=1e-13)


def test_a_measurement_decides_between_branches_by_their_likelihoods():
    """Bayes' rule on the mixtures' densities, by SciPy. Rounding."""
    made, z = branched(LEFT, RIGHT, odds=[0.8, 0.2]), np.array([1.5])
    made.columns[:] = 0.0
    likelihoods = [multivariate_normal(H @ m, H @ P @ H.T + R).pdf(z) for m, P, _ in (LEFT, RIGHT)]
    made.update_linear(z, H, R)
    expected = np.array([0.8, 0.2]) * likelihoods
    np.testing.assert_allclose(made.branch_odds, expected / expected.sum(), rtol=1e-12)


def test_branches_are_weighed_with_what_is_considered_and_their_modes_without():
    """Shapes err as constants do, forces of modes must not hide in them. Bayes' rule twice, by SciPy. Rounding."""
    made, z = branched(LEFT, RIGHT, odds=[0.8, 0.2]), np.array([1.5])
    for f, x in zip(made.filters, ([-1.0, 0.2], [-0.2, 0.1], [2.0, -0.1], [1.0, 0.3]), strict=True):
        f.x = np.array(x)
    whole, alone = (
        np.array(
            [
                multivariate_normal(H @ f.x, H @ (f.P + share * columns @ columns.T) @ H.T + R).pdf(z)
                for f, columns in zip(made.filters, made.columns, strict=True)
            ]
        ).reshape(2, 2)
        for share in (1.0, 0.0)
    )
    made.update_linear(z, H, R)
    branch = np.array([0.8, 0.2]) * (whole @ MU)
    mode = MU * alone / (alone @ MU)[:, None]
    np.testing.assert_allclose(made.branch_odds, branch / branch.sum(), rtol=1e-12)
    np.testing.assert_allclose(made.mu.reshape(2, 2) / made.branch_odds[:, None], mode, rtol=1e-12)


@pytest.mark.parametrize(
    ("odds", "least", "kept"),
    [
        ([0.5, 0.25, 0.25], 0.25, [0, 1, 2]),  # as probable as that
        ([0.5, 0.375, 0.125], 0.25, [0, 1]),
        ([0.125, 0.125, 0.75], 0.25, [2]),
        ([0.25, 0.5, 0.25], 0.9, [1]),  # all are less probable: the best stays
        ([0.25, 0.375, 0.375], 0.9, [1, 2]),
    ],
)
def test_branches_that_are_less_probable_are_given_up(odds, least, kept):
    """The others stay as they are, their odds made to sum to one, and go on as if there had been no more."""
    beliefs = [LEFT, RIGHT, MIDDLE]
    made = branched(*beliefs, odds=odds)
    prune(made, least)
    rest = np.array(odds)[kept] / np.array(odds)[kept].sum()
    assert made.n_branches == len(kept)
    assert made.repairs["pruned"] == 3 - len(kept)
    np.testing.assert_allclose(made.branch_odds, rest, rtol=1e-14)
    np.testing.assert_allclose(made.mode_odds, MU, rtol=1e-14)
    expected = branched(*[beliefs[k] for k in kept], odds=rest)
    for _ in range(2):
        np.testing.assert_allclose(means(made), means(expected), rtol=1e-14)
        np.testing.assert_allclose(made.columns, expected.columns, rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(made.x, expected.x, rtol=1e-14)
        np.testing.assert_allclose(made.P, expected.P, rtol=1e-13)
        np.testing.assert_array_equal(made.chain.mode_odds, made.mu)
        made.predict(0.1)
        expected.predict(0.1)


def test_pruning_counts_all_that_were_given_up():
    made = branched(LEFT, RIGHT, odds=[0.9, 0.1])
    prune(made, 0.5)
    branched(LEFT, RIGHT, MIDDLE, odds=[0.9, 0.05, 0.05], made=made)
    prune(made, 0.5)
    assert made.repairs == {"branched": 3, "pruned": 3}


def test_one_branch_is_never_given_up():
    made = mixture()
    x = made.x
    prune(made, 2.0)
    assert made.n_branches == 1
    assert made.x is x


def test_a_restart_ends_all_branches_and_keeps_the_odds_of_the_modes():
    made = branched(LEFT, RIGHT, odds=[0.5, 0.5])
    made.mu = np.array([0.1, 0.2, 0.3, 0.4])
    made.restart(*MIDDLE)
    assert made.n_branches == len(made.filters) - 1 == 1
    np.testing.assert_allclose(made.mu, [0.4, 0.6], rtol=1e-14)
    np.testing.assert_array_equal(made.columns, [MIDDLE[2]] * 2)
    made.predict(0.1)
    np.testing.assert_allclose(made.x, F @ MIDDLE[0], rtol=1e-14)


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
    made = branched(LEFT, RIGHT, odds=[0.5, 0.5])
    before = means(made)
    with pytest.raises(CovarianceError, match=r"^innovation: expected a finite likelihood, found nan and -?\d"):
        made.update_linear(np.array([np.nan]), H, R)
    np.testing.assert_array_equal(means(made), before)
    assert made.branch_odds[0] == 0.5
