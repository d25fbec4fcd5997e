"""The motion of a continuum against SciPy's exponentials, and its filter against finite elements of another mesh."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from dynamics import ParameterUncertainty, parameters
from dynamics.elements import continuum, continuum_network
from dynamics.mesh import Tissue, lumped_masses, rest_stiffness, surface
from estimators import MarkMeasurement, OpenLoop, TissueFilter, normalised_error_squared
from estimators.core import Disturbances, TissueProcess
from estimators.core.motion import SOURCES
from estimators.core.statics import Statics
from estimators.process.process_model import accumulated_noise
from tests.dynamics.blocks import block

SIZE = (0.1, 0.08, 0.05)
FAT = Tissue("fat", 3e3, 0.4, 950.0, 0.03)
TARGET = np.array([0.055, 0.041, 0.022])
HZ, SD_M = 1.0 / 30.0, 5e-4


def marks_at(places):
    return {f"M{k}": place for k, place in enumerate(places)}


MARKS = marks_at(
    np.array([[x, y, 0.05] for x in (0.01, 0.05, 0.09) for y in (0.015, 0.04, 0.065)] + [[0.1, 0.03, 0.03]])
)


def held(mesh):
    return np.flatnonzero(mesh.nodes[:, 2] < 1e-9)


@pytest.fixture(scope="module")
def network():
    mesh = block((8, 6, 4), SIZE)
    return continuum_network(mesh, (FAT,), held(mesh), MARKS | {"target": TARGET})


@pytest.fixture(scope="module")
def process(network):
    return TissueProcess(network, list(MARKS))


def generator(process):
    """The matrix of the motion by its equations, and the noise density of each source at unit variance."""
    motion, solid = process.motion, process.network.continuum
    r, n, n_f = len(solid.rates), 1 + len(solid.rates), len(motion.driving)
    A = np.zeros((2 * n + n_f, 2 * n + n_f))
    A[1:n, n + 1 : 2 * n] = np.eye(r)
    A[n + 1 : 2 * n, 1:n] = -np.diag(solid.rates)
    A[n + 1 : 2 * n, n + 1 : 2 * n] = -np.diag(solid.damping)
    A[n + 1 : 2 * n, 2 * n :] = motion._basis
    A[2 * n :, 2 * n :] = -np.diag(1.0 / motion.fading_s)
    densities = np.zeros((4, len(A), len(A)))
    densities[0, n + 1 : 2 * n, n + 1 : 2 * n] = np.diag(process.span.white[1:] ** 2)
    for source in (1, 3):
        own = 2 * n + np.flatnonzero(motion.driving == source)
        densities[source, own, own] = 2.0 / motion.fading_s[motion.driving == source]
    return A, densities


@pytest.mark.parametrize("dt", [1.0 / 200.0, HZ, 0.4])
def test_the_motion_is_that_of_its_equations(process, dt):
    A, densities = generator(process)
    exact, moving = expm(A * dt), process.parts["velocity"].stop
    state = np.random.default_rng(0).normal(size=len(A))
    found = process.motion.along(state, dt)
    scale = np.abs(exact[:moving]).max()
    np.testing.assert_allclose(found.motion, exact[:moving], atol=1e-7 * scale)
    np.testing.assert_allclose(found.mean, exact @ state, atol=1e-7 * scale)
    for source, density in enumerate(densities):
        expected = accumulated_noise(A, density, dt)
        size = np.sqrt(np.outer(expected.diagonal(), expected.diagonal())) + 1e-30
        assert np.abs((found.noises[source] - expected) / size).max() < 1e-3, SOURCES[source]


def test_columns_of_constants_are_derivatives_of_the_motion_by_them(network):
    """Truth: the equations of motion of a tissue a little stiffer and softer, by central differences."""
    which = parameters(network)
    process = TissueProcess(network, list(MARKS), statics=Statics(ParameterUncertainty(which, [[1e-2]])))
    A, n = generator(process)[0], process.parts["position"].stop
    state = np.zeros(len(A))
    state[0], state[1:n] = 1.0, 1e-3 / network.continuum.rates  # as a force bends it
    column = process.motion.along(state, HZ / 8.0).by_constants[:, 0]
    ends = []
    for sign in (1.0, -1.0):
        other = A.copy()
        other[n + 1 : 2 * n, 1:n] -= sign * 1e-2 * network.continuum.by_tissue[0]
        ends.append(expm(other * HZ / 8.0) @ state)
    exact = 0.5 * (ends[0] - ends[1])[: 2 * n]
    for part in (slice(0, n), slice(n, 2 * n)):
        assert np.linalg.norm(column[part] - exact[part]) < 0.1 * np.linalg.norm(exact[part])


def truth(seconds):
    """Places of marks and target [m] by finite elements: another mesh, pressed by a plate for a time, and breathing.

    By the trapezoidal rule on all nodes, in steps of an eighth of a frame.
    """
    mesh = block((11, 9, 6), SIZE, jitter=0.2)
    free = np.setdiff1d(np.arange(len(mesh.nodes)), held(mesh))
    K = csc_array(rest_stiffness(mesh, 1.5 * FAT.young_pa, FAT.poisson, free))  # the filter has two thirds of it
    masses = np.repeat(lumped_masses(mesh, FAT.density_kg_m3)[free], 3)
    M, C = diags_array(masses), FAT.damping_s * K
    outside = surface(mesh)
    drawn = np.array([*MARKS.values(), TARGET])
    weights = continuum.points_of(mesh, outside, drawn).weights
    rows = np.kron(weights.toarray()[:, free], np.eye(3))
    at = mesh.nodes[outside.nodes]
    plate = np.zeros((len(mesh.nodes), 3))
    near = np.exp(-(((at[:, :2] - [0.07, 0.05]) / 0.025) ** 2).sum(axis=1)) * (at[:, 2] > 0.0499) * outside.areas
    plate[outside.nodes, 2] = -near
    breath = masses * np.tile([1.0, 0.0, 0.0], len(free))
    h = HZ / 8.0
    factor = splu(csc_array(M + 0.5 * h * C + 0.25 * h**2 * K))
    x, v, found = np.zeros(len(masses)), np.zeros(len(masses)), []
    for step in range(int(seconds / h)):
        t = (step + 0.5) * h
        force = 4.0 * np.sin(2.0 * np.pi * 0.3 * t) * breath
        force = force + 1500.0 * np.clip((t - 1.0) / 0.3, 0.0, 1.0) * plate[free].ravel()
        change = factor.solve(h * (force - K @ (x + 0.5 * h * v) - C @ v))
        x, v = x + h * (v + 0.5 * change), v + change
        if step % 8 == 7:
            found.append((rows @ x).reshape(-1, 3) + drawn)
    return np.array(found)


@pytest.fixture(scope="module")
def tracked(network):
    """Errors of filter and open loop [m], covariances, and how far the target moves."""
    rng, places = np.random.default_rng(3), truth(3.0)
    which = parameters(network)
    tissue = TissueFilter(network, "target", list(MARKS), uncertainty=ParameterUncertainty(which, [[0.4]]))
    loop, errors, loops, covs = OpenLoop(network, "target"), [], [], []
    for k, now in enumerate(places):
        time_s = (k + 1) * HZ
        marks = [
            MarkMeasurement(name, place + SD_M * rng.normal(size=3), SD_M**2 * np.eye(3))
            for name, place in zip(MARKS, now, strict=False)
        ]
        tissue.predict(time_s)
        found = tissue.update(marks)
        errors.append(found.mean - now[-1])
        covs.append(found.cov)
        loops.append(loop.update(time_s, marks).mean - now[-1])
    return np.array(errors), np.array(covs), np.array(loops), np.linalg.norm(places[:, -1] - TARGET, axis=1)


def test_the_target_is_found_in_tissue_of_another_mesh_and_stiffness(tracked):
    errors, covs, loops, moved = (one[15:] for one in tracked)
    assert moved.max() > 2e-3
    rms, loop_rms = (np.sqrt((one**2).sum(axis=1).mean()) for one in (errors, loops))
    assert rms < 0.4 * loop_rms
    assert normalised_error_squared(errors, covs).mean() < 3.0 * 3.0


def test_few_modes_find_it_where_many_do(network, monkeypatch):
    """To 0.1 mm while the body breathes; to half a millimetre, and surer, where a small plate presses it."""
    chosen = continuum._modes
    monkeypatch.setattr(continuum, "LEFT_OUT", 3e-4)
    monkeypatch.setattr(continuum, "_modes", lambda *given: chosen(*given[:-1], given[-2]))  # not at points: anywhere
    mesh = block((8, 6, 4), SIZE)
    every = continuum_network(mesh, (FAT,), held(mesh), MARKS | {"target": TARGET})
    assert len(every.continuum.rates) > 1.8 * len(network.continuum.rates)
    rng, places = np.random.default_rng(3), truth(1.6)
    both = [TissueFilter(body, "target", list(MARKS), disturbances=Disturbances()) for body in (network, every)]
    for k, now in enumerate(places):
        marks = [
            MarkMeasurement(name, place + SD_M * rng.normal(size=3), SD_M**2 * np.eye(3))
            for name, place in zip(MARKS, now, strict=False)
        ]
        for tissue in both:
            tissue.predict((k + 1) * HZ)
        few, many = (tissue.update(marks) for tissue in both)
        if k < 5:
            continue  # the start depends on how many shapes it may have
        ratio = np.sqrt(np.trace(few.cov) / np.trace(many.cov))
        if (k + 1) * HZ < 1.0:
            assert np.linalg.norm(few.mean - many.mean) < 1e-4
            assert ratio == pytest.approx(1.0, abs=0.15)
        assert np.linalg.norm(few.mean - many.mean) < 5e-4
        assert ratio > 0.55
