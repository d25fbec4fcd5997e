"""The methods to compare with, on a line where the Kalman filter is right, and on the phantom where it is not."""

from itertools import pairwise, product

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics import HIDDEN, OUTER
from estimators import (
    EnsembleKalmanFilter,
    ExtendedKalmanFilter,
    FilterSettings,
    ForceMode,
    MarkMeasurement,
    ParticleFilter,
    Status,
    StockUnscented,
    TissueFilter,
    TissueModel,
)
from estimators.baselines import particles
from estimators.baselines.particles import resample
from tests.estimators.conftest import followed, poked_frames
from tests.networks import held_masses

R = 1e-6 * np.eye(2)
MODE = ForceMode(white=0.2, poke=0.3, lasting_s=0.2)
ONE = FilterSettings(poked=MODE)


@pytest.fixture(scope="module")
def taut():
    return held_masses(drag=0.4)


def frames(n=12, seed=0):
    """A mark a millimetre or so about rest, 15 frames/s, each third one not seen."""
    rng = np.random.default_rng(seed)
    return [(k / 15.0, [] if k % 3 == 2 else [MarkMeasurement("mass", rng.normal(0.0, 1e-3, 2), R)]) for k in range(n)]


def started(model, mode):
    """At rest, as uncertain as a second of this mode makes it: the integral of exp(A s) D exp(A' s), by midpoints."""
    A, D = model.linearised(model.network.positions, mode)
    step, F, P = expm(A / 2000.0), expm(A / 4000.0), np.zeros_like(A)
    for _ in range(2000):
        P, F = P + F @ D @ F.T / 2000.0, step @ F
    return np.zeros(len(A)), P


def kalman(taut, shown):
    """Means and covariances of the mass by the textbook, from a second of pokes on; SciPy's exponentials."""
    model = TissueModel(taut, ("mass",))
    x, P = started(model, MODE)
    A, _ = model.linearised(taut.positions, MODE)
    F, Q, H = expm(A / 120.0), model.noise(1 / 120.0, MODE), np.eye(6)[:2]
    means, covs = [], []
    for k, (_, marks) in enumerate(shown):
        for _ in range(8 if k else 0):
            x, P = F @ x, F @ P @ F.T + Q
        if marks:
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x, P = x + K @ (marks[0].position - H @ x), (np.eye(6) - K @ H) @ P
        means.append(x[:2])
        covs.append(P[:2, :2])
    return np.array(means), np.array(covs)


@pytest.mark.parametrize("kind", [ExtendedKalmanFilter, "particles"])
def test_on_a_line_it_is_the_kalman_filter(taut, kind, monkeypatch):
    """Means to 0.2 % of a sigma, covariances to 0.5 %: the poke held for a step, and the springs' second order."""
    shown = frames()
    if kind == "particles":
        monkeypatch.setattr(particles, "QUIET", MODE)  # both modes alike
        method = ParticleFilter(taut, "mass", ("mass",), ONE, rng=np.random.default_rng(0), n_particles=8)
    else:
        method = kind(taut, "mass", ("mass",), ONE)
    found = followed(method, shown)
    means, covs = kalman(taut, shown)
    sigma = np.sqrt(covs[:, 0, 0])[:, None]
    assert np.abs(([e.mean for e in found] - means) / sigma).max() < 0.02
    np.testing.assert_allclose([e.cov[0, 0] for e in found], covs[:, 0, 0], rtol=0.02)
    assert [e.status for e in found[2:5]] == [Status.COASTING, Status.TRACKING, Status.TRACKING]


def test_an_ensemble_nears_the_kalman_filter_with_its_size(taut):
    """Mean distance in sigmas over 12 frames: near 1 / sqrt(N), so a third for nine times the members (2 to 4.5)."""
    shown = frames()
    means, covs = kalman(taut, shown)
    sigma = np.sqrt(covs[:, 0, 0])[:, None]

    def off(n_members):
        distances = []
        for seed in range(6):
            rng = np.random.default_rng(seed)
            method = EnsembleKalmanFilter(taut, "mass", ("mass",), ONE, rng=rng, n_members=n_members)
            distances.append(np.abs(([e.mean for e in followed(method, shown)] - means) / sigma).mean())
        return np.mean(distances)

    assert 2.0 < off(60) / off(540) < 4.5
    with pytest.raises(ValueError, match="n_members: expected more than the 6 states"):
        EnsembleKalmanFilter(taut, "mass", ("mass",), ONE, rng=np.random.default_rng(0), n_members=6)


def test_stock_filterpy_adds_its_noise_once_a_frame(taut):
    """Against the same with noise at each step the covariance differs by more than 2 % at 5 frames/s, not at 60."""

    def unlike(shown):
        kinds = StockUnscented, ExtendedKalmanFilter
        stock, extended = (followed(kind(taut, "mass", ("mass",), ONE), shown)[-1].cov[0, 0] for kind in kinds)
        return abs(stock / extended - 1.0)

    marks = [MarkMeasurement("mass", np.zeros(2), R)]
    assert unlike([(0.0, marks), (0.2, [])]) > 0.02
    assert unlike([(k / 60.0, marks) for k in range(6)]) < 0.02


def test_histories_of_two_modes_are_all_counted(taut, monkeypatch):
    """With room for every history the mean is that of the exact sum over them: five frames, 2^5 of them. 2e-6 m."""
    modes = ForceMode(0.05, 0.05, 0.05), ForceMode(0.05, 3.0, 0.2)
    monkeypatch.setattr(particles, "QUIET", modes[0])
    settings = FilterSettings(poked=modes[1])
    shown = [(k / 30.0, [MarkMeasurement("mass", np.array([1e-3 * k**2, 0.0]), R)]) for k in range(5)]
    method = ParticleFilter(taut, "mass", ("mass",), settings, rng=np.random.default_rng(0), n_particles=10_000)
    found = followed(method, shown)[-1]
    model, H = TissueModel(taut, ("mass",)), np.eye(6)[:2]
    rates = np.array([[-1.0 / 8.0, 1.0 / 8.0], [1.0 / 0.3, -1.0 / 0.3]])
    turn, odds = expm(rates / 30.0), expm(rates * 100.0)[0]  # long-run
    x0, P0 = started(model, modes[1])
    K = P0 @ H.T @ np.linalg.inv(H @ P0 @ H.T + R)
    x0, P0 = x0 + K @ (shown[0][1][0].position - H @ x0), (np.eye(6) - K @ H) @ P0
    logs, means = [], []
    for history in product(range(2), repeat=5):
        x, P, log = x0, P0, np.log(odds[history[0]])
        for (a, b), (_, marks) in zip(pairwise(history), shown[1:], strict=True):
            log += np.log(turn[a, b])
            mode = modes[b]
            for _ in range(4):
                ahead, behind = (model.propagate(x + by * np.eye(6), 1 / 120, mode) for by in (1e-6, -1e-6))
                F = (ahead - behind).T / 2e-6
                x, P = model.propagate(x[None], 1 / 120, mode)[0], F @ P @ F.T + model.noise(1 / 120, mode)
            S, y = H @ P @ H.T + R, marks[0].position - H @ x
            log -= 0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
            K = P @ H.T @ np.linalg.inv(S)
            x, P = x + K @ y, (np.eye(6) - K @ H) @ P
        logs.append(log)
        means.append(x[:2])
    weights = np.exp(np.array(logs) - max(logs))
    expected = weights @ np.array(means) / weights.sum()
    np.testing.assert_allclose(found.mean, expected, rtol=0, atol=2e-6)
    poked = sum(w for w, h in zip(weights, product(range(2), repeat=5), strict=True) if h[-1] == 1) / weights.sum()
    assert found.poked == pytest.approx(poked, abs=5e-3)


def test_fewer_weights_are_unbiased_distinct_and_no_more_than_asked_for():
    """Mean weight of each of eight kept four at a time is its own, to four standard errors of 1,500 draws, 0.02."""
    weights = np.array([0.5, 0.2, 0.1, 0.06, 0.05, 0.04, 0.03, 0.02])
    total, rng = np.zeros(8), np.random.default_rng(0)
    for _ in range(1500):
        kept, new = resample(weights, 4, rng)
        assert len(set(kept.tolist())) == len(kept) <= 4
        assert new.sum() == pytest.approx(1.0, abs=1e-12)
        assert {0, 1} <= set(kept.tolist())
        total[kept] += new
    np.testing.assert_allclose(total / 1500, weights, rtol=0, atol=0.02)
    kept, new = resample(np.array([0.0, 0.3, 0.7]), 5, rng)
    assert kept.tolist() == [1, 2]
    np.testing.assert_allclose(new, [0.3, 0.7])


def test_on_the_poked_phantom_modes_are_worth_their_room(phantom, hidden):
    """2.5 s, 4.14 mm, truth by DOP853, constants known: ours within 1.2 of the particles, one mode 1.3 times ours."""
    shown, states = poked_frames(2.5, 0.00414, 0)
    methods = {
        "filter": TissueFilter(phantom, HIDDEN, OUTER, FilterSettings(discrepancy=1e-3)),
        "particles": ParticleFilter(phantom, HIDDEN, OUTER, rng=np.random.default_rng(0), n_particles=15),
        "ekf": ExtendedKalmanFilter(phantom, HIDDEN, OUTER),
        "stock": StockUnscented(phantom, HIDDEN, OUTER),
    }
    rms = {}
    for name, method in methods.items():
        off = np.array([e.mean for e in followed(method, shown)]) - states[:, hidden]
        rms[name] = np.sqrt((off**2).sum())
    assert rms["filter"] < 1.2 * rms["particles"]
    assert min(rms["ekf"], rms["stock"]) > 1.3 * rms["filter"]


def test_before_marks_and_for_bad_ones(taut):
    method = ExtendedKalmanFilter(taut, "mass", ("mass",), ONE)
    with pytest.raises(ValueError, match="expected predict"):
        method.update([])
    method.predict(1.0)
    assert method.update([]).status is Status.INITIALISING
    with pytest.raises(ValueError, match=r"expected 1.0 or later, found 0.5"):
        method.predict(0.5)
    method.update([MarkMeasurement("mass", np.zeros(2), R)])
    with pytest.raises(ValueError, match="mark mass position"):
        method.update([MarkMeasurement("mass", np.zeros(3), np.eye(3))])


def test_it_is_predicted_over_five_seconds_at_most(taut, monkeypatch):
    method, moved = ExtendedKalmanFilter(taut, "mass", ("mass",), ONE), []
    followed(method, frames(3))
    monkeypatch.setattr(method, "_advance", moved.append)
    method.predict(1.0)
    method.predict(1e9)
    assert moved == [pytest.approx(1.0 - 2.0 / 15.0), FilterSettings().forget_s]
    assert method.time_s == 1e9
