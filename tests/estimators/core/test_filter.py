"""The filter of hypotheses, against Kalman's equations by filterpy and against searches of SciPy; no tissue in it."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from estimators.core import filter as core
from estimators.core import moments
from estimators.core.filter import HypothesisFilter
from estimators.core.protocols import Transition
from tests.estimators.core.bodies import PUSHED, SPEED, Point, Seen


def textbook(variance: float) -> KalmanFilter:
    known = KalmanFilter(dim_x=2, dim_z=1)
    known.F, known.H, known.Q = SPEED, np.array([[1.0, 0.0]]), variance * PUSHED
    known.P = np.diag([4.0, 1.0])
    return known


def test_one_mode_is_kalmans_filter() -> None:
    found, known = HypothesisFilter(Point([0.3])), textbook(0.09)
    known.R = np.array([[0.04]])
    for value in (0.3, 0.9, 1.1, 2.2):
        found.predict(0.5)
        known.predict()
        nis = found.update([Seen(value, 0.04)])
        known.update(value)
        np.testing.assert_allclose(found.mean, known.x.ravel(), rtol=1e-12)
        np.testing.assert_allclose(found.covs[0], known.P, rtol=1e-9)
        assert nis == pytest.approx(float((known.y.T @ np.linalg.solve(known.S, known.y)).item()), rel=1e-9)
        assert found.log_likelihood == pytest.approx(float(known.log_likelihood), rel=1e-9)


def test_two_observations_of_a_frame_are_taken_in_together() -> None:
    """As one after the other, for their errors are independent."""
    found, known = HypothesisFilter(Point([0.3])), textbook(0.09)
    found.predict(0.5)
    known.predict()
    found.update([Seen(0.3, 0.04), Seen(0.5, 0.2)])
    for value, variance in ((0.3, 0.04), (0.5, 0.2)):
        known.update(value, R=np.array([[variance]]))
    np.testing.assert_allclose(found.mean, known.x.ravel(), rtol=1e-12)
    np.testing.assert_allclose(found.covs[0], known.P, rtol=1e-9)


def test_modes_are_mixed_and_weighed_as_interacting_models() -> None:
    """One cycle by the published equations: mixing, prediction, likelihoods."""
    rates = np.array([[-0.4, 0.4], [1.0, -1.0]])
    found = HypothesisFilter(Point([0.1, 5.0], rates))
    found.predict(0.5)
    found.update([Seen(6.0, 0.04)])
    means, covs, odds = found.means.copy(), found.covs.copy(), found.weights.copy()
    assert 0.3 < odds[1] < 0.999
    joint = odds[:, None] * expm(0.5 * found.rates)
    found.predict(0.5)
    found.update([Seen(8.1, 0.04)])
    weights, likelihoods, expected = joint.sum(axis=0), [], []
    for j, sd in enumerate((0.1, 5.0)):
        shares = joint[:, j] / weights[j]
        mean = shares @ means
        cov = sum(s * (P + np.outer(m - mean, m - mean)) for s, m, P in zip(shares, means, covs, strict=True))
        mean, cov = SPEED @ mean, SPEED @ cov @ SPEED.T + sd**2 * PUSHED
        likelihoods.append(multivariate_normal.pdf(8.1, mean[0], cov[0, 0] + 0.04))
        expected.append(mean + cov[:, 0] / (cov[0, 0] + 0.04) * (8.1 - mean[0]))
    np.testing.assert_allclose(found.means, expected, rtol=1e-9)
    np.testing.assert_allclose(found.weights, weights * likelihoods / (weights @ likelihoods), rtol=1e-9)
    mixed = found.weights @ expected
    spread = sum(
        w * (P + np.outer(m - mixed, m - mixed)) for w, m, P in zip(found.weights, expected, found.covs, strict=True)
    )
    mean, cov = found.moments(np.eye(2))
    np.testing.assert_allclose(mean, mixed, rtol=1e-12)
    np.testing.assert_allclose(cov, spread, rtol=1e-9)
    mean, cov = found.moments(np.array([[0.0, 2.0]]))
    np.testing.assert_allclose(mean, 2.0 * mixed[1:], rtol=1e-12)
    np.testing.assert_allclose(cov, 4.0 * spread[1:, 1:], rtol=1e-9)


@pytest.mark.parametrize(("rate", "least", "most"), [(0.25, 0.14, 0.36), (0.0, 0.0, 0.03)])
def test_the_rate_of_onsets_is_that_of_the_marks(rate: float, least: float, most: float) -> None:
    """50 s at 2 Hz: pushes that last 1 s begin at this rate [1/s], or never; the process states 0.1 /s."""
    rng, state, is_pushed = np.random.default_rng(2), np.zeros(2), False
    found = HypothesisFilter(Point([0.01, 20.0], np.array([[-0.1, 0.1], [1.0, -1.0]])))
    chain = expm(0.5 * np.array([[-rate, rate], [1.0, -1.0]]))
    for _ in range(100):
        is_pushed = bool(rng.random() < chain[int(is_pushed), 1])
        state = SPEED @ state + (20.0 if is_pushed else 0.01) * rng.choice([-1.0, 1.0]) * np.array([0.125, 0.5])
        found.predict(0.5)
        found.update([Seen(state[0] + 0.01 * rng.normal(), 1e-4)])
    assert least < found.rates[0, 1] < most


def test_a_mode_that_the_marks_refute_is_not_mixed_into_the_other() -> None:
    """A thousandth of a wide mode would double the variance of a narrow one."""
    rates = np.array([[-1e-3, 1e-3], [1e-3, -1e-3]])
    found, alone = HypothesisFilter(Point([0.01, 50.0], rates)), HypothesisFilter(Point([0.01]))
    for _ in range(30):
        for one in (found, alone):
            one.predict(0.5)
            one.update([Seen(0.0, 1e-4)])
    assert found.weights[1] < 1e-3
    np.testing.assert_allclose(found.covs[0], alone.covs[0], rtol=1e-6)


def test_a_hypothesis_less_probable_than_its_births_is_left_out_until_marks_ask_for_it() -> None:
    """Marks at rest refute a wide mode; one that jumps brings it back, with the covariance of what it is born from."""
    rates = np.array([[-1e-3, 1e-3], [1e-3, -1e-3]])
    found = HypothesisFilter(Point([0.01, 50.0], rates))
    for _ in range(10):
        found.predict(0.5)
        found.update([Seen(0.0, 1e-4)])
    assert found.weights[1] == 0.0
    narrow, chain = found.covs[0].copy(), expm(0.5 * found.rates)
    found.predict(0.5)
    born = SPEED @ narrow @ SPEED.T + 50.0**2 * PUSHED
    np.testing.assert_allclose(found.covs[1], born, rtol=1e-9)
    np.testing.assert_allclose(found.weights[1], chain[0, 1], rtol=1e-9)
    found.update([Seen(5.0, 1e-4)])
    assert found.weights[1] > 0.999
    assert found.mean[0] == pytest.approx(5.0, abs=0.03)


def test_what_is_left_out_hardly_moves_the_mixture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against all hypotheses in every frame: means and deviations within the share that may be left out."""
    rates = np.array([[-0.02, 0.02], [0.5, -0.5]])
    some, every = HypothesisFilter(Point([0.1, 5.0], rates)), HypothesisFilter(Point([0.1, 5.0], rates))
    rng, place, left, usual = np.random.default_rng(3), 0.0, 0, core.REBORN
    for k in range(120):
        place += 3.0 * (k % 40 in (10, 11))
        seen = Seen(place + 0.05 * rng.normal(), 0.0025)
        for one, share in ((some, usual), (every, 0.0)):
            monkeypatch.setattr(core, "REBORN", share)
            one.predict(0.5)
            one.update([seen])
        left += int((some.weights == 0.0).any())
        (mean, cov), (whole, spread) = (one.moments(np.eye(2)) for one in (some, every))
        deviations = np.sqrt(spread.diagonal())
        assert (np.abs(mean - whole) < usual * deviations).all()
        np.testing.assert_allclose(np.sqrt(cov.diagonal()), deviations, rtol=usual)
    assert left > 5


def test_a_nonlinear_observation_is_taken_where_it_fits() -> None:
    """The most probable state, which a search by SciPy finds, not what the slope at the prediction gives."""
    found = HypothesisFilter(Point([0.3]))
    found.predict(0.5)
    mean, cov = found.means[0].copy(), found.covs[0].copy()
    square, slope = (lambda x: (x + 2.0) ** 2), (lambda x: 2.0 * (x + 2.0))
    found.update([Seen(16.0, 0.04, square, slope)])

    def misfit(state: np.ndarray) -> float:
        away = state - mean
        return float(away @ np.linalg.solve(cov, away) + (16.0 - square(state[0])) ** 2 / 0.04)

    best = minimize(misfit, mean, tol=1e-14, method="Nelder-Mead", options={"maxiter": 4000}).x
    np.testing.assert_allclose(found.means[0], best, atol=2e-3)
    assert abs(best[0] - 1.92) < 0.1, "the slope at the prediction leads to 2.98"


def test_the_last_linearisation_allowed_is_the_one_that_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """With one alone: the extended filter, and its likelihood, by the slope at the prediction."""
    monkeypatch.setattr(core, "LINEARISATIONS", 1)
    found = HypothesisFilter(Point([0.3]))
    mean, cov = found.means[0].copy(), found.covs[0].copy()
    found.update([Seen(16.0, 0.04, lambda x: (x + 2.0) ** 2, lambda x: 2.0 * (x + 2.0))])
    H = np.array([4.0, 0.0])
    S = H @ cov @ H + 0.04
    np.testing.assert_allclose(found.means[0], mean + cov @ H * 12.0 / S, rtol=1e-12)
    assert found.log_likelihood == pytest.approx(multivariate_normal.logpdf(16.0, 4.0, S), rel=1e-9)


def test_a_bent_process_is_linearised_where_the_marks_show_that_it_was() -> None:
    """The mean is the one that follows from the most probable state before and after, by SciPy."""
    point = Point([0.2], bend=1.5)
    found = HypothesisFilter(point)
    found.predict(0.5)
    found.update([Seen(2.5, 1e-4)])
    _, (prior,) = point.prior(1.0)

    def misfit(before_and_push: np.ndarray) -> float:
        before, push = before_and_push[:2], before_and_push[2]
        after = point.moved(before, 0.5) + 0.2 * push * np.array([0.125, 0.5])
        return float(before @ np.linalg.solve(prior, before) + push**2 + (2.5 - after[0]) ** 2 / 1e-4)

    best = minimize(misfit, np.zeros(3), tol=1e-14, method="Nelder-Mead", options={"maxiter": 8000}).x
    expected = point.moved(best[:2], 0.5) + 0.2 * best[2] * np.array([0.125, 0.5])
    np.testing.assert_allclose(found.mean, expected, atol=0.03)
    once = point.linearize(np.zeros(2), 0.5)
    assert abs((once.matrix @ best[:2])[1] - expected[1]) > 0.5, "linearised at the prediction it would be far off"


class Saturating(Point):
    """A point whose place after a step is an arctangent of the place before: from afar, whole steps overshoot."""

    def moved(self, state: np.ndarray, dt: float) -> np.ndarray:
        return np.array([np.arctan(6.0 * (state[0] + 0.7)), state[1]])

    def linearize(self, state: np.ndarray, dt: float, cov: object = None) -> Transition:
        matrix = np.diag([6.0 / (1.0 + 36.0 * (state[0] + 0.7) ** 2), 1.0])
        return Transition(self.moved(state, dt), matrix, PUSHED[None])


def test_a_step_of_the_linearisation_is_halved_until_it_fits_better() -> None:
    """The slope is that at the place before that leads to what was seen, by the tangent."""
    found = HypothesisFilter(Saturating([1e-3], bend=1.0))
    found.predict(0.5)
    found.update([Seen(0.5, 1e-4)])
    slope = 6.0 / (1.0 + np.tan(0.5) ** 2)
    assert found.found is not None
    assert found.found.S[0, 0, 0] == pytest.approx(4.0 * slope**2, rel=0.03)
    assert found.mean[0] == pytest.approx(0.5, abs=1e-3)


def test_the_error_that_the_last_step_leaves_is_noise_of_all_states_of_a_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """With one step allowed: two places that bend by different amounts, and both get the mean square."""
    monkeypatch.setattr(core, "LINEARISATIONS", 2)

    class Two(Point):
        def moved(self, state: np.ndarray, dt: float) -> np.ndarray:
            return state + np.array([0.1 * state[0] ** 2, 0.0])

        def linearize(self, state: np.ndarray, dt: float, cov: object = None) -> Transition:
            return Transition(self.moved(state, dt), np.diag([1.0 + 0.2 * state[0], 1.0]), np.zeros((1, 2, 2)))

    point = Two([1.0], bend=1.0)
    point.parts = {"position": slice(0, 2)}
    found = HypothesisFilter(point)
    found.predict(0.5)
    found.update([Seen(1.0, 1e-4)])
    gain = 4.0 / (4.0 + 1e-4)
    assert found.covs[0, 1, 1] == pytest.approx(1.0 + 0.5 * (0.1 * gain**2) ** 2, rel=1e-6)


@pytest.mark.parametrize(("acting", "columns"), [(0, 0), (3, 5), (5, 3), (7, 7)])
def test_covariances_are_propagated_by_the_whole_matrix(acting: int, columns: int) -> None:
    """Whatever rows and columns of the transition are zero beside its diagonal."""
    rng = np.random.default_rng(1)
    T, roots = np.diag(rng.normal(size=7)), rng.normal(size=(4, 7, 7))
    T[:acting, :columns] += rng.normal(size=(acting, columns))
    covs, noises, independent, variances = roots @ roots.swapaxes(1, 2), roots[:2, :4, :4], rng.random((1, 7)), roots[0]
    noises = noises + noises.swapaxes(1, 2)
    variances = np.square(rng.normal(size=(4, 3)))
    found = moments.moved(covs, T)
    moments.add_noise(found, Transition(np.zeros(7), T, noises, independent), variances)
    for P, own, moved in zip(covs, variances, found, strict=True):
        expected = T @ P @ T.T + own[2] * np.diag(independent[0])
        expected[:4, :4] += own[0] * noises[0] + own[1] * noises[1]
        np.testing.assert_allclose(moved, expected, atol=1e-12)


@pytest.mark.parametrize("is_independent", [False, True])
@pytest.mark.parametrize("is_spread", [False, True])
def test_predicted_covariances_and_products_are_those_of_mixtures_with_noise(
    is_independent: bool, is_spread: bool
) -> None:
    """Of three Gaussians in four modes, of which one has a single Gaussian."""
    rng = np.random.default_rng(2)
    T, roots, means, H = rng.normal(size=(7, 7)), rng.normal(size=(5, 7, 7)), rng.normal(size=(3, 7)), np.zeros((2, 7))
    H[:, 1:6:2] = rng.normal(size=(2, 3))
    P, noises, independent = roots[:3] @ roots[:3].swapaxes(1, 2), roots[3:, :4, :4], rng.random((2, 7))
    noises, spread = noises @ noises.swapaxes(1, 2), 0.1 * np.eye(3)
    variances, added, shares = rng.random((4, 4 if is_independent else 2)), rng.random(7), rng.random((3, 4))
    variances[:, 1] = 0.3  # equal in all modes
    shares[:, 0] = 1.0, 0.0, 0.0
    shares /= shares.sum(axis=0)
    own = {"independent": independent} if is_independent else {}
    transition = Transition(np.zeros(7), T, noises, **own, spread=spread if is_spread else None)
    before = moments.Prior(means, tuple(P), np.ones(3) / 3.0, shares, np.eye(4), 0.1, 0.0)
    found = moments.Predicted.of(before, means, transition, variances, added)
    expected = np.zeros((4, 7, 7))
    for k, (share, variance) in enumerate(zip(shares.T, variances, strict=True)):
        apart = means - share @ means
        expected[k] = np.tensordot(share, T @ P @ T.T, 1) + (apart.T * share) @ apart + np.diag(added)
        expected[k, :4, :4] += np.tensordot(variance[:2], noises, 1)
        expected[k, :3, :3] += spread if is_spread else 0.0
        expected[k] += np.diag(variance[2:] @ independent) if is_independent else 0.0
    np.testing.assert_allclose(found.times(H), H @ expected, atol=1e-12)
    np.testing.assert_allclose(found.each(np.arange(4)), expected, atol=1e-12)
    expected[[0, 2]] = 0.0
    np.testing.assert_allclose(found.each(np.array([1, 3])), expected, atol=1e-12)


class Constant(Seen):
    """Has one derivative for all states, as marks have; that of `Seen` is made new for each."""

    rows = np.array([[1.0, 0.0]])

    def linearize(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return super().linearize(state)[0], self.rows


class Speed(Constant):
    """The velocity."""

    rows = np.array([[0.0, 1.0]])

    def linearize(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.rows @ state, self.rows


def test_each_hypothesis_has_its_innovation() -> None:
    """For a nonlinear observation by the slope at its own mean, and for states that no observation sees completely."""
    rates = np.array([[-0.4, 0.4], [1.0, -1.0]])
    found = HypothesisFilter(Point([0.1, 5.0], rates))
    for value in (0.3, 4.0):
        found.predict(0.5)
        found.update([Seen(value, 0.04)])
    assert np.ptp(found.means[:, 0]) > 1e-3
    seen = found.innovations([Seen(9.0, 0.04, lambda x: x**2, lambda x: 2.0 * x), Speed(1.0, 0.5)])
    for (x, v), P, y, S in zip(found.means, found.covs, seen.y, seen.S, strict=True):
        H = np.diag([2.0 * x, 1.0])
        np.testing.assert_allclose(y, [9.0 - x**2, 1.0 - v], rtol=1e-12)
        np.testing.assert_allclose(S, H @ P @ H.T + np.diag([0.04, 0.5]), rtol=1e-12)


def test_innovations_are_those_of_the_present_state() -> None:
    """They are kept for the update of the same observations, and no longer."""
    found, seen = HypothesisFilter(Point([0.3])), Seen(1.0, 0.04)
    other = Seen(2.0, 0.04)
    assert found.innovations([seen]) is found.innovations([seen])
    assert found.innovations([other]).y[0, 0] == 2.0
    prior = found.innovations([seen])
    assert prior.y[0, 0] == 1.0
    assert prior.S[0, 0, 0] == pytest.approx(4.04)
    found.update([seen])
    updated = found.innovations([seen])
    assert updated.y[0, 0] == pytest.approx(1.0 - 4.0 / 4.04)
    found.predict(0.5)
    assert found.innovations([seen]).S[0, 0, 0] > updated.S[0, 0, 0] + 0.1
    found.restart()
    assert found.innovations([seen]).S[0, 0, 0] == pytest.approx(4.04)
