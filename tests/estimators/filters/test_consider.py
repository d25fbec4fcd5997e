"""Constants that are considered and not estimated: against the textbook, and what becomes of a filter without them."""

import numpy as np
import pytest

from estimators import InteractingMixture, UnscentedKalmanFilter, mean_bounds
from estimators.filters.kernels import (
    mixed_each,
    moments,
    moments_each,
    regressions,
    schmidt_update,
    symmetric_points,
    symmetric_points_each,
    with_columns,
)
from estimators.filters.mixture import nearest_definite
from estimators.filters.motion import Move

DT = 0.1
F = np.array([[1.0, DT, 0.0, 0.0], [-0.4, 0.98, 0.3, 0.0], [0.0, 0.0, 1.0, DT], [0.3, 0.0, -0.5, 0.97]])
"""Two masses, places and velocities; only the first mass's place is seen."""
B = np.array([[0.0, 0.0], [0.05, 0.0], [0.0, 0.0], [0.02, 0.08]])
"""What two unknown constant forces, one standard deviation each, do in a step."""
Q = np.diag([1e-6, 1e-3, 1e-6, 1e-3])
H, R = np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([[0.01]])
START = np.zeros(4), np.diag([0.5, 0.3, 0.4, 0.2])


def considered(columns=True, alone=False):
    """A mixture of two modes that are alike: one filter, with what the two forces make of its error beside it."""
    filters = []
    for _ in range(2):
        f = UnscentedKalmanFilter(4, lambda s, _dt: s @ F.T)
        f.Q = Q
        filters.append(f)

    def carried(means, old, _dt):
        return np.array([F @ own + B for own in old])

    move = Move(lambda points, _dt: points @ F.T, carried)
    mixture = InteractingMixture(filters, np.array([0.5, 0.5]), np.zeros((2, 2)), move)
    mixture.considered = not alone
    mixture.restart(START[0], START[1], np.zeros((4, 2 if columns else 0)))
    return mixture


def schmidt(zs):
    """Schmidt and Kalman's filter in its textbook form: the state and the forces together, gain rows of the forces 0.

    Source: [bierman1977], chapter VIII.
    """
    x, P = np.zeros(6), np.zeros((6, 6))
    P[:4, :4], P[4:, 4:] = START[1], np.eye(2)
    A, W, G = np.eye(6), np.zeros((6, 6)), np.zeros((1, 6))
    A[:4, :4], A[:4, 4:], W[:4, :4], G[:, :4] = F, B, Q, H
    for z in zs:
        x, P = A @ x, A @ P @ A.T + W
        if z is not None:
            K = P @ G.T @ np.linalg.inv(G @ P @ G.T + R)
            K[4:] = 0.0
            keep = np.eye(6) - K @ G
            x, P = x + K @ (z - G @ x), keep @ P @ keep.T + K @ R @ K.T
        yield x[:4], P[:4, :4], P[:4, 4:]


def followed(mixture, zs):
    for z in zs:
        mixture.predict(DT)
        if z is not None:
            mixture.update_linear(z, H, R)
        yield mixture


def test_it_is_schmidts_filter():
    """Mean, covariance and cross covariance over 100 steps, every third unseen. 1e-10."""
    rng = np.random.default_rng(0)
    zs = [None if k % 3 == 2 else rng.normal(size=1) for k in range(100)]
    for ours, (x, P, cross) in zip(followed(considered(), zs), schmidt(zs), strict=True):
        np.testing.assert_allclose(ours.x, x, rtol=0, atol=1e-10)
        np.testing.assert_allclose(ours.P, P, rtol=0, atol=1e-10)
        np.testing.assert_allclose(ours.columns[0], cross, rtol=0, atol=1e-10)


def runs(columns):
    """NEES of all four states after 60 steps in 25 runs, each with forces drawn anew."""
    nees = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        force = rng.normal(size=2)
        x = np.linalg.cholesky(START[1]) @ rng.normal(size=4)
        mixture = considered(columns)
        for _ in range(60):
            x = F @ x + B @ force + np.sqrt(np.diag(Q)) * rng.normal(size=4)
            mixture.predict(DT)
            mixture.update_linear(H @ x + 0.1 * rng.normal(size=1), H, R)
        off = x - mixture.x
        nees.append(off @ np.linalg.solve(mixture.P, off))
    return np.array(nees)


def test_the_covariance_knows_of_the_constants():
    """Mean NEES of 25 runs inside its 99.9 % bounds about 4; without the columns it is past three times that."""
    low, high = mean_bounds(4, 25, 0.999)
    assert low < runs(columns=True).mean() < high
    assert runs(columns=False).mean() > 3.0 * high


def test_where_nothing_is_considered_columns_are_sensitivities():
    """d(mean error)/d(force) of a filter that knows of no force: by running it on shifted truths. Linear: 1e-10."""
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(40, 1))

    def errors(force):
        x, mixture = np.zeros(4), considered(alone=True)
        for n in noise:
            x = F @ x + B @ force
            mixture.predict(DT)
            mixture.update_linear(H @ x + n, H, R)
        return x - mixture.x, mixture

    base, mixture = errors(np.zeros(2))
    plain = considered(columns=False)
    list(followed(plain, noise))
    np.testing.assert_allclose(mixture.x, plain.x, rtol=0, atol=1e-12)
    for k in range(2):
        shifted, _ = errors(np.eye(2)[k])
        np.testing.assert_allclose(mixture.columns[0][:, k], shifted - base, rtol=0, atol=1e-10)


def test_innovations_are_told_of():
    mixture = considered()
    mixture.predict(DT)
    before = mixture.columns.copy()
    mixture.update_linear(np.zeros(1), H, R)
    np.testing.assert_allclose(mixture.innovation_columns, H @ before, rtol=0, atol=1e-15)


def test_narrow_points_are_counted_and_change_no_linear_model():
    """The unscented transform of a line is exact however far its points spread. 1e-10."""
    usual, narrow = considered(), considered()
    narrow.move = Move(narrow.move.points, narrow.move.columns, lambda points: np.array([True, False]))
    for mixture in (usual, narrow):
        for _ in range(5):
            mixture.predict(DT)
    np.testing.assert_allclose(narrow.x, usual.x, rtol=0, atol=1e-10)
    np.testing.assert_allclose(narrow.P, usual.P, rtol=0, atol=1e-10)
    assert narrow.repairs == {"narrowed": 5}
    assert usual.repairs == {}


def test_narrow_points_stay_near_the_mean():
    """A twentieth of the usual spread, so that no point goes where the model must not be asked."""
    seen = []
    mixture = considered()
    mixture.move = Move(
        lambda points, _dt: seen.append(points) or points @ F.T, None, lambda points: np.array([True, False])
    )
    mixture.predict(DT)
    spread = [np.abs(points - points[0]).max() for points in seen[0]]
    assert spread[0] == pytest.approx(0.05 * spread[1], rel=1e-12)


def test_a_covariance_that_is_none_is_mended_and_counted():
    mixture = considered()
    mixture.filters[0].P = np.diag([0.5, -1e-9, 0.4, 0.2])
    mixture.predict(DT)
    assert mixture.repairs == {"definite": 1}
    assert np.linalg.eigvalsh(mixture.P)[0] > 0


def test_mending_lifts_what_is_below_rounding_and_keeps_the_rest():
    """Scales of 1e-6 and 1e3 side by side: of the correlations, so that a small unit is no small eigenvalue."""
    units = np.array([1e-6, 1.0, 1e3])
    good = np.array([[1.0, 0.5, 0.2], [0.5, 1.0, 0.1], [0.2, 0.1, 1.0]])
    np.testing.assert_allclose(
        nearest_definite(good * np.outer(units, units)) / np.outer(units, units), good, atol=1e-12
    )
    bad = np.array([[1.0, 1.0, 0.0], [1.0, 1.0 - 1e-10, 0.0], [0.0, 0.0, 1.0]])
    mended = nearest_definite(bad * np.outer(units, units))
    np.linalg.cholesky(mended)
    np.testing.assert_allclose(mended / np.outer(units, units), bad, atol=1e-9)


def beliefs(rng, k=3, n=4, r=2):
    roots = rng.normal(size=(k, n, n))
    return rng.normal(size=(k, n)), roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(n), rng.normal(size=(k, n, r))


def test_kernels_for_several_are_the_kernels_for_one():
    rng = np.random.default_rng(2)
    xs, Ps, _ = beliefs(rng)
    scales = np.array([4.0, 1.0, 0.1])
    points, definite = symmetric_points_each(xs, Ps, scales)
    assert definite.all()
    Wm, Wc, Qs = rng.random((3, 9)), rng.random((3, 9)), rng.normal(size=(3, 4, 4))
    means, covs = moments_each(points, Wm, Wc, Qs)
    for k in range(3):
        np.testing.assert_array_equal(points[k], symmetric_points(xs[k], Ps[k], scales[k])[0])
        mean, cov = moments(points[k], Wm[k], Wc[k], Qs[k])
        np.testing.assert_array_equal(means[k], mean)
        np.testing.assert_array_equal(covs[k], cov)
    Ps[1] = -Ps[1]
    assert symmetric_points_each(xs, Ps, scales)[1].tolist() == [True, False, True]


def test_the_regression_of_a_linear_map_is_its_matrix():
    """1e-10 of entries of one: two triangular substitutions."""
    rng = np.random.default_rng(3)
    xs, Ps, _ = beliefs(rng)
    points, _ = symmetric_points_each(xs, Ps, np.full(3, 4.0))
    maps = rng.normal(size=(3, 4, 4))
    moved = np.einsum("kij,kpj->kpi", maps, points) + 0.3
    np.testing.assert_allclose(regressions(points, moved), maps, rtol=0, atol=1e-10)


@pytest.mark.parametrize(("n", "r"), [(4, 0), (4, 2), (4, 3), (70, 1), (70, 5)])
def test_mixtures_with_columns_keep_the_total_covariance(n, r):
    """Errors e + C t of each part, e ~ (0, P), t ~ (0, 1) common: total variance, and covariance with t. Rounding."""
    rng = np.random.default_rng(4)
    xs, Ps, Cs = beliefs(rng, n=n, r=r)
    w = np.ascontiguousarray(rng.dirichlet(np.ones(3), size=2).T)
    means, covs, columns = mixed_each(w, xs, Ps, Cs)
    for j in range(2):
        mean = w[:, j] @ xs
        total = sum(w[i, j] * (Ps[i] + Cs[i] @ Cs[i].T + np.outer(xs[i] - mean, xs[i] - mean)) for i in range(3))
        np.testing.assert_allclose(means[j], mean, rtol=0, atol=1e-13)
        np.testing.assert_allclose(with_columns(covs[j], columns[j]), total, rtol=0, atol=1e-13 * np.abs(total).max())
        np.testing.assert_array_equal(covs[j], covs[j].T)
        np.testing.assert_allclose(columns[j], np.einsum("i,iab->ab", w[:, j], Cs), rtol=0, atol=1e-13)


def test_the_update_takes_its_gain_from_the_total():
    """K = T H' (H T H' + R)^-1, P = (1 - K H) P (1 - K H)' + K R K', for T other than P. 1e-12."""
    rng = np.random.default_rng(5)
    (x, *_), (P, *_), (C, *_) = beliefs(rng)
    G, noise, z = rng.normal(size=(2, 4)), np.diag([0.3, 0.7]), rng.normal(size=2)
    T = with_columns(P, C)
    r = C.shape[1]
    found = schmidt_update(x, P, z, G, noise, C, np.zeros((2, r)), 1.0, np.zeros(r), np.zeros((r, 0)))
    S = G @ T @ G.T + noise
    K = T @ G.T @ np.linalg.inv(S)
    keep = np.eye(4) - K @ G
    np.testing.assert_allclose(found[0], x + K @ (z - G @ x), rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[1], keep @ P @ keep.T + K @ noise @ K.T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[3], S, rtol=0, atol=1e-12)
    assert found[5] == pytest.approx((z - G @ x) @ np.linalg.solve(S, z - G @ x), rel=1e-12)
