"""Errors of the target at rest, against equilibria with wrong constants and with marks held elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, four_mass_phantom, parameter_forces, parameters, rest_shape, scale_parameters
from estimators import ErrorSource, StaticResponse, TissueFilter


@pytest.fixture(scope="module")
def tissue() -> TissueFilter:
    return TissueFilter(four_mass_phantom(), HIDDEN, OUTER)


def held_at_marks(network, positions):
    """Where all nodes rest while the marked ones are held here [m], (n_nodes, dim)."""
    held = network.fixed.copy()
    held[[network.index(node) for node in OUTER]] = True
    return rest_shape(replace(network, positions=positions, fixed=held))


def test_a_target_follows_constants_that_are_wrong(tissue):
    """The hidden mass on springs 1 % stiffer."""
    network = tissue.network
    which = parameters(network, ("stiffness",))
    stiffer = scale_parameters(network, which, np.full(len(which), 0.01))
    shift = (held_at_marks(stiffer, network.positions) - network.positions)[network.index(HIDDEN)]
    response = StaticResponse(tissue, OUTER)
    forces = parameter_forces(network, which, response.rest, np.zeros_like(response.rest))
    moved = response.to_forces(forces.T @ np.full((len(which), 1), 0.01))
    np.testing.assert_allclose(moved[:, 0], shift, rtol=0.02, atol=1e-9)


def test_a_target_follows_marks_that_are_off(tissue):
    """Every mark by its own 20 um: so little that springs stay straight to 1 %."""
    network = tissue.network
    off = 2e-5 * np.array([[1.0, -0.5], [0.3, 0.8], [-0.6, 0.2]])
    positions = network.positions.copy()
    positions[[network.index(node) for node in OUTER]] += off
    shift = (held_at_marks(network, positions) - held_at_marks(network, network.positions))[network.index(HIDDEN)]
    moved = StaticResponse(tissue, OUTER).to_marks(off.reshape(-1, 1))
    np.testing.assert_allclose(moved[:, 0], shift, rtol=0.01, atol=1e-9)


def test_independent_directions_add_their_squares():
    source = ErrorSource.of("made up", np.array([[3e-3, 0.0, 1e-3], [0.0, 2e-3, 0.0]]), considered=False)
    np.testing.assert_allclose(source.cov, [[1e-5, 0.0], [0.0, 4e-6]])
    assert source.variance == pytest.approx(1.4e-5)
