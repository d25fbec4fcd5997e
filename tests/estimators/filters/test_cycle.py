"""A mixture whose motion is linearised: Kalman's equations, and Gauss-Newton's where the motion bends."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import minimize

from estimators.filters.iterated import SETTLED
from estimators.filters.mixture import InteractingMixture
from estimators.filters.motion import LinearMotion, Move
from estimators.filters.noise_level import NoiseLevel
from estimators.filters.unscented import UnscentedKalmanFilter

DT, SD = 0.1, 0.2
F = np.array([[1.0, DT], [0.0, 1.0]])
Q = np.diag([1e-4, 1e-2])
H = np.array([[1.0, 0.0]])
R = np.array([[SD**2]])
RATES = np.array([[-1.0, 1.0], [2.0, -2.0]])


def mixture_of(motion, passes=3):
    """Two modes that differ by nothing but their odds, moved by this motion of states (k, n)."""
    filters = [UnscentedKalmanFilter(2, lambda points, _dt: points) for _ in range(2)]
    move = Move(points=lambda points, _dt: points, linear=lambda _dt, _level: (motion, passes))
    mixture = InteractingMixture(filters, np.array([0.5, 0.5]), RATES, move)
    mixture.restart(np.array([1.0, 2.0]), np.eye(2), np.zeros((2, 0)))
    return mixture


def motion_of(ends, F, Q, n_coupled=2):
    """To first order, without columns; all its noise is white."""
    none = np.zeros((*ends.shape, 0))
    return LinearMotion(ends, F, Q, none, np.linalg.cholesky(Q), n_coupled, np.zeros(ends.shape[1]))


def straight(about):
    """A motion that is the same wherever it is linearised."""
    k = len(about)
    return motion_of(about @ F.T, np.tile(F, (k, 1, 1)), np.tile(Q, (k, 1, 1)))


def louder(level, about):
    """`straight` with this factor on its noise."""
    k = len(about)
    return motion_of(about @ F.T, np.tile(F, (k, 1, 1)), np.tile(level * Q, (k, 1, 1)))


def turning(about):
    """A pendulum's angle and rate, (k, 2): the velocity gains -10 sin(angle) a second; no noise."""
    k, angle = len(about), about[:, 0]
    ends = np.column_stack([angle + DT * about[:, 1], about[:, 1] - 10.0 * DT * np.sin(angle)])
    tangent = np.tile(F, (k, 1, 1))
    tangent[:, 1, 0] = -10.0 * DT * np.cos(angle)
    return motion_of(ends, tangent, np.tile(1e-6 * np.eye(2), (k, 1, 1)))


def test_a_linear_motion_is_kalmans():
    """Against the textbook's equations, ten steps: how often it is linearised changes nothing. Rounding."""
    mixture, x, P = mixture_of(straight), np.array([1.0, 2.0]), np.eye(2)
    for z in np.random.default_rng(1).normal(size=10):
        mixture.predict(DT)
        x, P = F @ x, F @ P @ F.T + Q
        np.testing.assert_allclose(mixture.P, P, rtol=1e-12)
        mixture.update_linear(np.array([z]), H, R)
        K = P @ H.T / (H @ P @ H.T + R)
        x, P = x + K @ (z - H @ x), (np.eye(2) - K @ H) @ P
        np.testing.assert_allclose(mixture.x, x, rtol=1e-10)
        np.testing.assert_allclose(mixture.P, P, rtol=1e-10)


@pytest.mark.parametrize("n_coupled", [0, 3, 5])
def test_states_moved_by_themselves_alone_need_no_whole_product(n_coupled):
    """F P F' + Q as it is written, of states of which the last are moved by a factor each. Rounding."""
    rng = np.random.default_rng(n_coupled)
    F, roots, noise = (rng.normal(size=(2, 5, 5)) for _ in range(3))
    F[:, n_coupled:] *= np.eye(5)[n_coupled:]
    P, Q = roots @ roots.swapaxes(1, 2), noise @ noise.swapaxes(1, 2)
    found = motion_of(np.zeros((2, 5)), F, Q, n_coupled).predicted(P)
    np.testing.assert_allclose(found, np.einsum("kab,kbc,kdc->kad", F, P, F) + Q, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found, found.swapaxes(1, 2))


def test_an_update_is_the_most_probable_path_where_the_motion_bends():
    """The start and the end of the least squares of prior, noise and measurement, found here by a search over starts.

    A wide start, an exact measurement of the end's velocity: about the mean of the start the motion has another slope.
    """
    prior, mean, z, noise = np.diag([1.0, 1e-4]), np.array([0.3, 0.0]), -0.8, 1e-4
    found = {}
    for passes in (1, 20):
        mixture = mixture_of(turning, passes=passes)
        mixture.restart(mean, prior, np.zeros((2, 0)))
        mixture.predict(DT)
        mixture.update_linear(np.array([z]), np.array([[0.0, 1.0]]), np.array([[noise]]))
        found[passes] = mixture.x[0]

    def cost(start):
        angle, rate = start
        ended = turning(start[None]).ends[0]
        # noise of 1e-6 between the motion's end and the place that is measured
        return (angle - mean[0]) ** 2 + rate**2 / 1e-4 + (ended[1] - z) ** 2 / (noise + 1e-6)

    best = minimize(cost, [0.9, 0.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x
    end = turning(best[None]).ends[0, 0]
    assert found[20] == pytest.approx(end, abs=0.01)
    assert abs(found[1] - end) > 0.05


def saturating(about):
    """A place whose end is five times the arc tangent of twice the start, and a rate that stays; no noise."""
    k, place = len(about), about[:, 0]
    ends = np.column_stack([5.0 * np.arctan(2.0 * place), about[:, 1]])
    tangent = np.tile(np.eye(2), (k, 1, 1))
    tangent[:, 0, 0] = 10.0 / (1.0 + 4.0 * place**2)
    return motion_of(ends, tangent, np.tile(1e-6 * np.eye(2), (k, 1, 1)))


@pytest.mark.parametrize("direction", [0.0, 3.0, 8.0])
def test_a_step_that_makes_the_marks_less_probable_is_shortened(direction):
    """Against a search over starts: from 2 on, whole steps of Gauss-Newton go ever further, to both sides in turn.

    direction: of an error that is considered, by its standard deviation, along the place
    """
    mean, z, noise = 2.0, 0.5, 0.25
    mixture = mixture_of(lambda about: replace(saturating(about), added=np.zeros((2, 2, 1))), passes=30)
    mixture.restart(np.array([mean, 0.0]), np.diag([4.0, 1.0]), np.array([[direction], [0.0]]))
    mixture.predict(DT)
    mixture.update_linear(np.array([z]), H, np.array([[noise]]))
    places = np.linspace(-1.0, 3.0, 400_001)
    costs = (places - mean) ** 2 / (4.0 + direction**2) + (5.0 * np.arctan(2.0 * places) - z) ** 2 / (noise + 1e-6)
    best = places[np.argmin(costs)]
    assert mixture.x[0] == pytest.approx(5.0 * np.arctan(2.0 * best), abs=4e-3)


def test_only_the_update_after_a_prediction_repeats_it():
    """A second measurement at the same time finds the first one's state, and changes it as Kalman's update does."""
    asked = []

    def counted(about):
        asked.append(len(about))
        return turning(about)

    mixture = mixture_of(counted)
    mixture.predict(DT)
    mixture.update_linear(np.array([3.0]), H, R)
    n = len(asked)
    assert n > 1
    x, P = mixture.filters[0].x.copy(), mixture.filters[0].P.copy()
    mixture.update_linear(np.array([2.5]), H, R)
    assert len(asked) == n
    K = P @ H.T / (H @ P @ H.T + R)
    np.testing.assert_allclose(mixture.filters[0].x, x + K @ (2.5 - H @ x), rtol=1e-12)


@pytest.mark.parametrize(("straight", "repeated"), [(0.0, True), (0.01, True), (10.0, False)])
def test_a_cycle_that_is_straight_as_far_as_its_end_moves_is_not_repeated(straight, repeated):
    """An update moves the end by about one; another pass but where the motion is straight as far as that."""
    asked = []

    def counted(about):
        asked.append(len(about))
        return replace(turning(about), straight=np.full(2, straight))

    mixture = mixture_of(counted)
    mixture.predict(DT)
    mixture.update_linear(np.array([3.0]), H, R)
    assert (len(asked) > 1) == repeated


def test_a_smoother_is_given_the_transition_as_it_was_linearised_last():
    """One transition for each prediction, whose F is that about the start after the update."""
    mixture = mixture_of(turning)
    mixture.trace = []
    mixture.predict(DT)
    first = mixture.trace[0].F[0, 1, 0]
    mixture.predict(DT)
    mixture.update_linear(np.array([3.0]), H, R)
    assert len(mixture.trace) == 2
    assert mixture.trace[0].F[0, 1, 0] == first
    np.testing.assert_allclose(
        mixture.trace[1].F[0] @ mixture.trace[1].covs[0] @ mixture.trace[1].F[0].T + 1e-6 * np.eye(2),
        mixture.trace[1].arrived.covs[0],
        rtol=1e-12,
    )
    assert abs(mixture.trace[1].F[0, 1, 0] + 10.0 * DT * np.cos(mixture.trace[1].means[0, 0])) > 1e-3


def test_a_prediction_mixes_then_moves_every_mode_and_its_columns():
    """Mixing by p_ij mu_i / c_j, then ends, F P F' + Q and F C + added, with a trace of all of it. Rounding.

    Noise that is symmetric to rounding only makes covariances that are so to the bit.
    """
    mixture, asked = mixture_of(straight), []
    added, skew = np.array([[[0.3], [-0.2]], [[0.1], [0.5]]]), np.array([[0.0, 1e-15], [0.0, 0.0]])

    def linear(dt, _level):
        asked.append(dt)
        return lambda about: replace(straight(about), Q=np.array([Q + skew, 2.0 * Q]), added=added), 1

    mixture.move = Move(mixture.move.points, linear=linear)
    mu, means = np.array([0.7, 0.3]), np.array([[1.0, 2.0], [-0.5, 0.4]])
    covs, columns = np.array([[[1.0, 0.2], [0.2, 0.5]], [[0.3, -0.1], [-0.1, 2.0]]]), np.array([[0.6], [-0.9]])
    mixture.mu, mixture.columns, mixture.trace = mu, np.array([columns, columns]), []
    for f, mean, P in zip(mixture.filters, means, covs, strict=True):
        f.x, f.P = mean, P
    mixture.predict(DT)
    p, (found,) = expm(RATES * DT), mixture.trace
    assert asked == [DT]
    np.testing.assert_allclose(found.weights, p * mu[:, None] / (mu @ p), rtol=1e-12)
    np.testing.assert_allclose(found.arrived.mu, mu @ p, rtol=1e-12)
    for j, (f, own, Q_j) in enumerate(zip(mixture.filters, added, (Q, 2.0 * Q), strict=True)):
        w = p[:, j] * mu / (mu @ p)[j]
        x = w @ means
        P = sum(w[i] * (covs[i] + np.outer(means[i] - x, means[i] - x)) for i in range(2))
        np.testing.assert_allclose(found.means[j], x, rtol=1e-12)
        np.testing.assert_allclose(found.covs[j], P, rtol=1e-12)
        np.testing.assert_array_equal(found.F[j], F)
        np.testing.assert_allclose(f.x, F @ x, rtol=1e-12)
        np.testing.assert_allclose(f.P, F @ P @ F.T + Q_j, rtol=1e-12)
        np.testing.assert_array_equal(f.P, f.P.T)
        np.testing.assert_allclose(mixture.columns[j], F @ columns + own, rtol=1e-12)
        np.testing.assert_array_equal(found.arrived.means[j], f.x)
        np.testing.assert_array_equal(found.arrived.covs[j], f.P)


def counted(motion, asked):
    """That motion, each call of which is noted."""

    def noted(about):
        asked.append(about)
        return motion(about)

    return noted


@pytest.mark.parametrize("passes", [1, 2, 5])
def test_a_motion_that_never_settles_is_linearised_as_often_as_it_may_be(passes):
    """Ends that jump to and fro by 20 from pass to pass, hundred deviations."""
    asked = []

    def restless(about):
        found = straight(about)
        return replace(found, ends=found.ends + 10.0 * (-1.0) ** len(asked))

    mixture = mixture_of(counted(restless, asked), passes=passes)
    mixture.predict(DT)
    mixture.update_linear(np.array([3.0]), H, R)
    assert len(asked) == passes


@pytest.mark.parametrize(("share", "n"), [(0.97, 1), (-0.97, 1), (1.03, 2), (-1.03, 2)])
def test_a_start_that_moves_by_little_is_not_linearised_again(share, n):
    """By that share of `SETTLED` deviations, by Kalman's gain for the start, p / (p + Q + R); a line settles at once.

    The rate, known exactly, does not move at all.
    """
    asked, p = [], 0.04
    mixture = mixture_of(counted(straight, asked))
    mixture.restart(np.zeros(2), np.diag([p, 0.0]), np.zeros((2, 0)))
    mixture.predict(DT)
    move = share * SETTLED * np.sqrt(p)
    mixture.update_linear(np.array([move * (p + Q[0, 0] + SD**2) / p]), H, R)
    assert len(asked) == n
    if n > 1:
        np.testing.assert_allclose(asked[1], [[move, 0.0]] * 2, rtol=1e-12)


@pytest.mark.parametrize("considered", [True, False])
def test_a_start_is_moved_for_its_considered_errors_too(considered):
    """A place off by an unknown c beside a p, of which Q, R and what the motion adds come between: Gaussian regression.

    Where gains do not allow for the columns, by p alone.
    """
    asked, p, c, added = [], 0.04, 0.3, 0.1
    own = np.array([[added], [0.0]])
    mixture = mixture_of(counted(lambda about: replace(straight(about), added=np.array([own, own])), asked))
    mixture.considered = considered
    mixture.restart(np.zeros(2), np.diag([p, 0.0]), np.array([[c], [0.0]]))
    mixture.predict(DT)
    mixture.update_linear(np.array([2.0]), H, R)
    alone, shared = p + Q[0, 0] + SD**2, c + added
    gain = (p + c * shared) / (alone + shared**2) if considered else p / alone
    np.testing.assert_allclose(asked[1], [[2.0 * gain, 0.0]] * 2, rtol=1e-12)


def test_the_level_of_its_noise_is_learnt():
    """All noise is white, and of a fifth or five times the stated density: mean logarithm of six runs within 0.3.

    Updates linearise a cycle anew, and every fourth cycle has none: the level hears of each prediction once.
    """
    for true in (0.2, 5.0):
        logs = []
        for seed in range(6):
            rng, x = np.random.default_rng(seed), np.array([1.0, 2.0])
            mixture = mixture_of(straight, passes=3)
            mixture.level = NoiseLevel((1e-3, 1e3), 2)
            mixture.move = Move(mixture.move.points, linear=lambda _dt, level: (partial(louder, level), 3))
            for k in range(200):
                x = F @ x + np.sqrt(true) * np.linalg.cholesky(Q) @ rng.normal(size=2)
                mixture.predict(DT)
                if k % 4:
                    mixture.update_linear(x[:1] + 1e-2 * rng.normal(size=1), np.eye(2)[:1], np.array([[1e-4]]))
            logs.append(np.log(mixture.level.scale / true))
        assert abs(np.mean(logs)) < 0.3
