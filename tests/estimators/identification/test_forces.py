"""The strength of unknown forces. Truth: linear finite elements of another mesh at rest under a slow force."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from dynamics.elements import continuum_network
from dynamics.mesh import Tissue, lumped_masses, rest_stiffness
from estimators import Budget, FilterSettings, MarkMeasurement, constant_groups
from estimators.identification import forces
from estimators.identification.problem import STRENGTH_PASSES, Problem
from tests.dynamics.blocks import block
from tests.estimators.identification.test_filter_pass import row

SIZE, SD_M = (0.06, 0.05, 0.04), 3e-4
FAT = Tissue("fat", 3e3, 0.4, 950.0, 0.05)
TRUTH = block((6, 4, 4), SIZE)
MARKED = {f"M{x}{y}": [0.06 * x, 0.05 * y, 0.04] for x in (0, 1) for y in (0, 1)}
HIDDEN = {"H": [0.03, 0.025, 0.04], "T": [0.03, 0.025, 0.02]}
AT = {name: int(((TRUTH.nodes - place) ** 2).sum(axis=1).argmin()) for name, place in (MARKED | HIDDEN).items()}
"""Node of the truth nearest to each of these places."""


def held(mesh):
    return np.flatnonzero(mesh.nodes[:, 2] < 1e-9)


@pytest.fixture(scope="module")
def problem():
    mesh = block((3, 3, 2), SIZE)
    network = continuum_network(mesh, (FAT,), held(mesh), {name: TRUTH.nodes[k] for name, k in AT.items()})
    groups = constant_groups(network)
    return Problem(network, groups, np.full(len(groups), 0.3), (tuple(MARKED), "T"), FilterSettings(), Budget())


def frames(acceleration):
    """A second in which the body is accelerated sideways and back, (time [s], marks)."""
    free, rng = np.setdiff1d(np.arange(len(TRUTH.nodes)), held(TRUTH)), np.random.default_rng(1)
    force = np.outer(lumped_masses(TRUTH, FAT.density_kg_m3), [acceleration, 0.0, 0.0])
    moved = np.zeros_like(TRUTH.nodes)
    moved[free] = spsolve(rest_stiffness(TRUTH, FAT.young_pa, FAT.poisson, free), force[free].ravel()).reshape(-1, 3)
    return [
        (t, [mark(name, TRUTH.nodes[k] + np.sin(np.pi * t) ** 2 * moved[k], rng) for name, k in AT.items()])
        for t in np.arange(30) / 30.0
    ]


def mark(name, place, rng):
    return MarkMeasurement(name, place + SD_M * rng.normal(size=3), SD_M**2 * np.eye(3))


def strength(found, given):
    return found.settings.poked.poke / given.settings.poked.poke


def test_stronger_forces_are_found_and_the_true_stiffness_fits_them(problem, monkeypatch):
    passes = []
    monkeypatch.setattr(Problem, "at", lambda *args, at=Problem.at: passes.append(1) or at(*args))
    weak, strong = (forces.with_likely_forces(problem, frames(a)) for a in (0.2, 20.0))
    assert len(passes) <= 2 * STRENGTH_PASSES
    assert strength(weak, problem) < 0.6
    assert 1.5 < strength(strong, problem) < 0.5 * forces.FURTHEST
    true = np.zeros(len(problem.groups))
    stated, likely = (one.at(true, frames(20.0)) for one in (problem, strong))
    assert likely.log_likelihood > stated.log_likelihood + 5.0
    assert abs(likely.gradient[0]) < 0.3 * abs(stated.gradient[0])


def test_out_of_time_the_strength_is_the_best_so_far(problem):
    """A clock that each look moves by a second: half of the time is three passes of 30 frames, or none."""
    seconds = iter(range(1000))
    limits = {limit: Budget(limit, lambda: float(next(seconds))) for limit in (190.0, 1e-3)}
    few, none = (forces.with_likely_forces(replace(problem, budget=one), frames(20.0)) for one in limits.values())
    assert strength(few, problem) > 1.5
    assert strength(none, problem) == 1.0


def test_the_forces_of_springs_are_as_stated(problem):
    network = row()
    groups = constant_groups(network, ("stiffness",))
    springs = Problem(network, groups, np.full(len(groups), 0.3), (("near",), "far"), FilterSettings(), Budget())
    assert forces.with_likely_forces(springs, []) is springs
