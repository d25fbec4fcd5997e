"""A block of tetrahedra as the tissue of a process: what the elements do is what the process moves by."""

from dataclasses import replace

import numpy as np

from dynamics import MassSpringNetwork
from dynamics.elements import Assembly, Tetrahedra, TissueConstants, continuum_network
from dynamics.mesh import lumped_masses, patches
from estimators import FilterSettings, TissueFilter, normalised_error_squared
from estimators.core import TissueProcess
from estimators.core.discrepancy import Discrepancy
from tests.dynamics.blocks import block
from tests.estimators.core.test_continuum import FAT, HZ, MARKS, SIZE, TARGET, held, seen


def test_a_block_of_tetrahedra_sways_as_its_slowest_vibration():
    """Let go in its slowest mode, it has crossed to the other side after half a period; springs are a millionth."""
    mesh = block((1, 1, 2), (0.04, 0.04, 0.08))
    n, masses = len(mesh.nodes), lumped_masses(mesh, 1000.0)
    springs = np.unique(np.sort(mesh.elements[:, [[0, 1], [1, 2], [2, 3]]].reshape(-1, 2), axis=1), axis=0)
    none, weak = np.zeros(n), np.full(len(springs), 1e-3)
    network = MassSpringNetwork(
        names=tuple(f"N{i}" for i in range(n)), positions=mesh.nodes, masses=masses, fixed=mesh.nodes[:, 2] < 1e-9,
        drag=none, friction=none, springs=springs, stiffness=weak, damping=0.0 * weak, gravity=np.zeros(3),
        rest_lengths=np.linalg.norm(mesh.nodes[springs[:, 1]] - mesh.nodes[springs[:, 0]], axis=1),
    )  # fmt: skip
    body = Tetrahedra(mesh, "corotated", TissueConstants(3e3, 0.49), patches(mesh))
    process = TissueProcess(network, ["N2"], elements=[body])
    rest = mesh.nodes[network.free].ravel()
    by_mass = np.repeat(masses[network.free], 3)
    K = Assembly(mesh.nodes, network.free, [body]).tangents(rest, 0.0 * rest)[0].toarray()
    squares, modes = np.linalg.eigh(K / np.sqrt(np.outer(by_mass, by_mass)))
    half, swing = np.pi / np.sqrt(squares[0]), 1e-4 * modes[:, 0] / np.sqrt(by_mass) * np.sqrt(by_mass.mean())
    state = process.prior(level=1.0)[0]
    state[process.parts["position"]] = rest + swing
    for _ in range(40):
        state = process.moved(state, half / 40)
    crossed = (state[process.parts["position"]] - rest) @ swing / (swing @ swing)
    assert -1.0 <= crossed < -0.97


def test_a_wall_that_is_elsewhere_in_the_first_frame_is_found():
    """The wall is still, 15 mm beside its drawn place, as if tracking started while a patient inhales."""
    mesh, rng = block((8, 6, 4), SIZE), np.random.default_rng(6)
    driven = continuum_network(mesh, (FAT,), held(mesh), MARKS | {"target": TARGET}, driven=True)
    tissue, shift = TissueFilter(driven, "target", list(MARKS)), np.array([0.0, 0.009, 0.012])
    errors, nees = [], []
    for k in range(12):
        tissue.predict(k * HZ)
        found = tissue.update(seen({name: place + shift for name, place in MARKS.items()}, rng))
        errors.append(np.linalg.norm(found.mean - TARGET - shift))
        nees.append(normalised_error_squared((found.mean - TARGET - shift)[None], found.cov[None])[0])
    assert errors[0] < 2e-3
    assert errors[-1] < 5e-4
    assert max(nees) < 7.8


def test_a_wall_that_moves_though_it_is_stated_to_be_fixed_is_a_part_of_the_discrepancy():
    """The whole block moves to and fro by 10 mm: errors and NEES are smaller than with no discrepancy at the wall."""
    mesh, given = block((8, 6, 4), SIZE), Discrepancy.of(FilterSettings(), solid=True)
    network, found = continuum_network(mesh, (FAT,), held(mesh), MARKS | {"target": TARGET}), []
    for prior in (given, replace(given, loose=0.0)):
        rng, tissue = np.random.default_rng(6), TissueFilter(network, "target", [*MARKS], discrepancy=prior)
        errors, covs = [], []
        for k in range(90):
            shift = 0.01 * np.sin(0.5 * np.pi * k * HZ) * np.array([0.6, 0.0, 0.8])
            tissue.predict(k * HZ)
            estimate = tissue.update(seen({name: place + shift for name, place in MARKS.items()}, rng))
            errors.append(estimate.mean - TARGET - shift)
            covs.append(estimate.cov)
        errors_m = np.array(errors)
        found.append(
            [np.linalg.norm(errors_m, axis=1).mean(), normalised_error_squared(errors_m, np.array(covs)).mean()]
        )
    (error_m, mean_nees), (pinned_m, pinned_nees) = found
    assert error_m < 0.85 * pinned_m
    assert mean_nees < 0.6 * pinned_nees
