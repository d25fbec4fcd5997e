"""Moments by sigma points: those of filterpy's unscented filter, and of a tangent where nothing bends."""

import numpy as np
import pytest
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter
from scipy.integrate import solve_ivp

from dynamics import HIDDEN, OUTER, four_mass_phantom, node_forces
from estimators import FilterSettings, MarkMeasurement, TissueFilter
from estimators.core.motion import by_sigma_points
from estimators.core.tissue import TissueProcess
from tests.estimators.conftest import followed

DT = 1.0 / 30.0


@pytest.fixture(scope="module")
def process() -> TissueProcess:
    return TissueProcess(four_mass_phantom(), OUTER, sigma_points=True)


def uncertain(process: TissueProcess, sd_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A state away from rest, and a covariance with correlations: sd_m of places, thirty times as much a second."""
    rng, mean = np.random.default_rng(3), process.prior(0.01)[0].copy()
    moving, force = process.parts["velocity"], process.parts["force"]
    mean[: moving.start] += 0.01 * rng.normal(size=moving.start)
    mean[force] = 2.0 * rng.normal(size=force.stop - force.start)
    root = np.diag(np.r_[np.full(moving.start, sd_m), np.full(moving.start, 30.0 * sd_m)])
    root = root @ (np.eye(moving.stop) + 0.2 * rng.normal(size=(moving.stop, moving.stop)))
    cov = 1e-6 * np.eye(process.n)
    cov[: moving.stop, : moving.stop] = root @ root.T
    return mean, cov


def test_they_are_those_of_filterpys_unscented_filter(process: TissueProcess) -> None:
    mean, cov = uncertain(process, 0.01)
    m = process.parts["velocity"].stop

    def moved(state: np.ndarray, _dt: float) -> np.ndarray:
        return process.motion.moved_each(np.r_[state, mean[m:]][None], DT)[0]

    stock = UnscentedKalmanFilter(m, 1, DT, lambda state: state[:1], moved, JulierSigmaPoints(m, kappa=0.0))
    stock.x, stock.P, stock.Q = mean[:m].copy(), cov[:m, :m].copy(), np.zeros((m, m))
    stock.predict()
    found = process.linearize(mean, DT, lambda: cov)
    own = found.matrix[:m, :m]
    assert found.spread is not None
    tangent = process.linearize(mean, DT)
    further = stock.x - process.motion.moved_each(mean[None], DT)[0]
    np.testing.assert_allclose((found.mean - tangent.mean)[:m], further, atol=1e-12)
    np.testing.assert_allclose(own @ cov[:m, :m] @ own.T + found.spread, stock.P, rtol=1e-6, atol=1e-9)
    assert np.abs(further).max() > 1e-3  # it bends


def test_where_the_motion_is_linear_they_are_its_tangent(process: TissueProcess) -> None:
    mean, cov = uncertain(process, 0.01)
    m = process.parts["velocity"].stop
    tangent = process.linearize(mean, DT)

    def linear(states: np.ndarray) -> np.ndarray:
        return tangent.mean[:m] + (states[:, :m] - mean[:m]) @ tangent.matrix[:m, :m].T

    found = by_sigma_points(tangent, mean, cov, m, linear)
    np.testing.assert_allclose(found.matrix, tangent.matrix, atol=1e-8)
    np.testing.assert_allclose(found.mean, tangent.mean, atol=1e-12)
    np.testing.assert_allclose(found.spread, 0.0, atol=1e-15)


def test_points_move_by_the_equations_of_motion(process: TissueProcess) -> None:
    """By an adaptive integrator and the network's own forces, to 0.1 mm: forces that fade are held at their mean."""
    network, (state, _) = process.network, uncertain(process, 0.01)
    n, force = process.parts["velocity"].start, process.parts["force"].start
    rows = np.concatenate([np.atleast_1d(np.arange(n)[network.coordinates(name)]) for name in OUTER])
    state[force + len(rows) : process.parts["force"].stop] = 0.0  # slow ones
    short, pushes = state[force : force + len(rows)], np.zeros(n)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        places, velocities = network.positions.copy(), np.zeros_like(network.positions)
        places[network.free], velocities[network.free] = y[:n].reshape(-1, 2), y[n:].reshape(-1, 2)
        forces = node_forces(network, places, velocities)[network.free].ravel()
        pushes[rows] = short * np.exp(-t / 0.2)
        return np.r_[y[n:], forces / np.repeat(network.masses[network.free], 2) + pushes]

    exact = solve_ivp(rate, (0.0, DT), state[: 2 * n], rtol=1e-9, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(process.motion.moved_each(state[None], DT)[0, :n], exact[:n], atol=1e-4)


def test_a_filter_is_as_its_settings_say() -> None:
    """Two frames of coarse marks."""

    def after_two_marks(**chosen: bool) -> np.ndarray:
        network = four_mass_phantom()
        places = {node: network.positions[network.index(node)] + 0.01 for node in OUTER}
        marks = [MarkMeasurement(node, place, 1e-4 * np.eye(2)) for node, place in places.items()]
        tissue = TissueFilter(network, HIDDEN, OUTER, FilterSettings(**chosen))
        estimate = followed(tissue, [(0.0, marks), (DT, marks)])[-1]
        return np.r_[estimate.mean, estimate.cov.ravel()]

    usual, points, tangent = after_two_marks(), after_two_marks(sigma_points=True), after_two_marks(sigma_points=False)
    np.testing.assert_array_equal(usual, tangent)
    np.testing.assert_allclose(points, tangent, rtol=0.3)
    assert not np.allclose(points, tangent, rtol=1e-6)
