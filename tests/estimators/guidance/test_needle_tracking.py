"""The tracked needle against the textbook's filter, and many runs of its own model."""

import numpy as np
import pytest

from estimators import NeedleNoise, NeedleTracker

D = np.array([0.6, -0.8])
NOISE = NeedleNoise(acceleration=0.03, bending=5e-4, speed_sd=0.04)
R = np.array([[4e-6, 1e-6], [1e-6, 2e-6]])


def transition(dt, noise=NOISE):
    """F and Q of position (2) and speed, by their definition: Q the integral of g g' written out."""
    F = np.array([[1.0, 0.0, 0.6 * dt], [0.0, 1.0, -0.8 * dt], [0.0, 0.0, 1.0]])
    along = np.r_[D, 0.0]
    across = np.array([0.8, 0.6, 0.0])
    speed = np.array([0.0, 0.0, 1.0])
    q, b = noise.acceleration**2, noise.bending**2
    Q = q * (
        dt**3 / 3 * np.outer(along, along)
        + dt**2 / 2 * (np.outer(along, speed) + np.outer(speed, along))
        + dt * np.outer(speed, speed)
    )
    return F, Q + b * dt * np.outer(across, across)


def simulated(rng, n, dt, noise=NOISE, speed=0.0):
    """True states (n, 3) and measurements (n, 2) of the model itself."""
    F, Q = transition(dt, noise)
    root, seen_root = np.linalg.cholesky(Q + 1e-30 * np.eye(3)), np.linalg.cholesky(R)
    x = np.r_[0.01, 0.02, speed or noise.speed_sd * rng.normal()]
    states, seen = [], []
    for k in range(n):
        if k:
            x = F @ x + root @ rng.normal(size=3)
        states.append(x)
        seen.append(x[:2] + seen_root @ rng.normal(size=2))
    return np.array(states), np.array(seen)


def tracked(seen, dt, noise=NOISE):
    tracker = NeedleTracker([0.0, 0.0], 5.0 * D, noise)
    for k, z in enumerate(seen):
        tracker.predict(k * dt)
        tracker.update(z, R)
    return tracker


def test_it_is_the_textbook_filter():
    """X = F x, P = F P F' + Q, K = P H' S^-1, P = (I - K H) P, written out; uneven times, and ahead; relative 1e-10."""
    rng = np.random.default_rng(0)
    _, seen = simulated(rng, 30, 0.05)
    times = np.cumsum(rng.uniform(0.01, 0.1, 30))
    tracker = NeedleTracker([0.0, 0.0], D, NOISE)
    H = np.eye(2, 3)
    for k, (t, z) in enumerate(zip(times, seen, strict=True)):
        tracker.predict(t)
        tracker.update(z, R)
        if k == 0:
            x, P = np.r_[z, 0.0], np.diag([0.0, 0.0, NOISE.speed_sd**2])
            P[:2, :2] = R
        else:
            F, Q = transition(t - times[k - 1])
            x, P = F @ x, F @ P @ F.T + Q
            S = H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            nis = (z - H @ x) @ np.linalg.inv(S) @ (z - H @ x)
            x, P = x + K @ (z - H @ x), (np.eye(3) - K @ H) @ P
            assert tracker.nis == pytest.approx(nis, rel=1e-9)
        np.testing.assert_allclose(tracker.x, x, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(tracker.P, P, rtol=1e-10, atol=1e-16)
    tip, cov = tracker.tip_at(t + 0.45)
    F, Q = transition(0.45)
    np.testing.assert_allclose(tip, (F @ x)[:2], rtol=1e-10)
    np.testing.assert_allclose(cov, (F @ P @ F.T + Q)[:2, :2], rtol=1e-10, atol=1e-16)


def test_the_arrival_is_as_uncertain_as_it_says():
    """A needle of 40 mm/s, 0.6 s seen, then 0.9 s to 60 mm beyond: 80 arrivals, off by what sd_s says within 20 %.

    Of 80 normal variables the root mean square is 1 to 8 %; the rest is for the first order of sd_s.
    """
    steady, off, sds = NeedleNoise(acceleration=3e-3, bending=5e-4, speed_sd=0.05), [], []
    for seed in range(80):
        states, seen = simulated(np.random.default_rng(seed), 100, 0.02, steady, 0.04)
        depth = states[:, :2] @ D
        aim = depth[0] + 0.06
        reached = np.flatnonzero(depth > aim)[0]
        said = tracked(seen[:30], 0.02, steady).arrival(aim)
        exact = reached - (depth[reached] - aim) / (depth[reached] - depth[reached - 1])
        off.append(said.time_s - 0.02 * exact)
        sds.append(said.sd_s)
    assert np.sqrt(np.mean((np.array(off) / np.array(sds)) ** 2)) == pytest.approx(1.0, abs=0.2)


def test_depth_and_speed_are_those_of_the_line():
    tracker = NeedleTracker([1.0, 2.0], D, NOISE)
    for k in range(200):
        tracker.predict(0.05 * k)
        tracker.update(np.array([1.0, 2.0]) + 0.02 * 0.05 * k * D, R)
    assert tracker.depth[0] == pytest.approx(0.02 * 0.05 * 199, abs=1e-6)
    assert tracker.speed[0] == pytest.approx(0.02, abs=1e-6)
    said = tracker.arrival(0.3)
    assert said.time_s == pytest.approx(0.3 / 0.02, abs=1e-3)
    assert tracker.arrival(0.1) is None
    np.testing.assert_allclose(tracker.tip_at(15.0)[0], np.array([1.0, 2.0]) + 0.3 * D, atol=1e-5)


def test_what_it_refuses():
    with pytest.raises(ValueError, match="direction: expected"):
        NeedleTracker([0.0, 0.0], [0.0, 0.0])
    tracker = NeedleTracker([0.0, 0.0], D)
    with pytest.raises(ValueError, match="update: expected predict"):
        tracker.update([0.0, 0.0], R)
    with pytest.raises(ValueError, match="tip_at: expected"):
        tracker.tip_at(1.0)
    assert tracker.arrival(0.1) is None
    tracker.predict(1.0)
    with pytest.raises(ValueError, match="tip: expected"):
        tracker.update([0.0, np.nan], R)
    tracker.update([0.0, 0.0], R)
    with pytest.raises(ValueError, match="time_s: expected"):
        tracker.predict(0.5)
