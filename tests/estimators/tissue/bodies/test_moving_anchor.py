"""An anchor that a clamp moves: a free node that is led, whose measured path comes with each frame as its mark."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dynamics import node_forces, rest_shape
from estimators import FilterSettings, MarkMeasurement, TissueFilter, coverage, normalised_error_squared
from tests.estimators.conftest import followed

SD_M, CLAMP_SD_M = 1e-3, 1e-4
TIMES_S = np.arange(0.0, 2.0, 1.0 / 30.0)


def clamp_path(t):
    """Where the clamp is, from where it was at first [m]."""
    return np.array([0.012 * np.sin(2.0 * np.pi * 0.6 * t), 0.006 * np.sin(2.0 * np.pi * 0.4 * t)])


def clamp_speed(t):
    speeds = [0.012 * 0.6 * np.cos(2.0 * np.pi * 0.6 * t), 0.006 * 0.4 * np.cos(2.0 * np.pi * 0.4 * t)]
    return 2.0 * np.pi * np.array(speeds)


@pytest.fixture(scope="module")
def moved(phantom):
    """The phantom's nodes [m], (n, n_nodes, 2), while In1 is led by a clamp: its equations by SciPy's RK45."""
    free, anchor, n = phantom.free, phantom.index("In1"), 2 * len(phantom.free)

    def placed(t, state):
        x, v = phantom.positions.copy(), np.zeros_like(phantom.positions)
        x[anchor], v[anchor] = x[anchor] + clamp_path(t), clamp_speed(t)
        x[free], v[free] = state[:n].reshape(-1, 2), state[n:].reshape(-1, 2)
        return x, v

    def rate(t, state):
        force = node_forces(phantom, *placed(t, state))
        return np.r_[state[n:], (force[free] / phantom.masses[free, None]).ravel()]

    start = np.r_[rest_shape(phantom)[free].ravel(), np.zeros(n)]
    states = solve_ivp(rate, (0.0, 2.0), start, t_eval=TIMES_S, max_step=0.01, rtol=1e-7, atol=1e-9).y.T
    return np.array([placed(t, state)[0] for t, state in zip(TIMES_S, states, strict=True)])


def estimated(network, moved, clamps, seed):
    """Errors of M2 [m], (n, 2), and their covariances."""
    rng, noise = np.random.default_rng(seed), dict.fromkeys(("M1", "M3", "M4"), SD_M)
    noise |= dict.fromkeys(clamps, CLAMP_SD_M)
    frames = []
    for t, places in zip(TIMES_S, moved, strict=True):
        seen = [(name, places[network.index(name)] + sd * rng.normal(size=2), sd) for name, sd in noise.items()]
        frames.append((float(t), [MarkMeasurement(name, at, sd**2 * np.eye(2)) for name, at, sd in seen]))
    found = followed(TissueFilter(network, "M2", tuple(noise), FilterSettings(led_nodes=clamps)), frames)
    means = np.array([one.mean for one in found])
    return means - moved[:, network.index("M2")], np.array([one.cov for one in found])


def test_a_clamp_that_moves_an_anchor_is_followed_by_its_measured_path(phantom, moved):
    """Less than 0.8 of the error of a filter that takes the anchor as fixed, and covered."""
    assert np.ptp(moved[:, phantom.index("M2")], axis=0).max() > 5e-3
    clamped = phantom.index("In1")
    fixed = phantom.fixed.copy()
    fixed[clamped] = False
    masses = phantom.masses.copy()
    masses[clamped] = 0.2
    led = replace(phantom, fixed=fixed, masses=masses)
    errors, covs = estimated(led, moved, ("In1",), 0)
    unaware, _ = estimated(phantom, moved, (), 0)
    assert np.linalg.norm(errors, axis=1).mean() < 0.8 * np.linalg.norm(unaware, axis=1).mean()
    assert coverage(normalised_error_squared(errors, covs), 2) > 0.9
