"""Blocks and sheets: static deflection, rest where they are drawn, Young's modulus of their lattices."""

import numpy as np
import pytest

from dynamics import node_forces, potential_energy
from experiments.simulation.bodies.body import Scale
from experiments.simulation.bodies.elastic import SHEET_KG_M2, SHEET_M, SHEET_N_M, block, floating_block, sheet


def test_a_hanging_sheet_is_stretched_by_its_weight():
    """By w H² / (2 E t), w its weight by area; to 15 %: its upper edge cannot narrow."""
    body = sheet(0, Scale(), seconds=0.1)
    drawn = body.network.positions
    stretched = np.ptp(drawn[:, 2]) - SHEET_M[1]
    assert stretched == pytest.approx(SHEET_KG_M2 * 9.81 * SHEET_M[1] ** 2 / (2.0 * SHEET_N_M), rel=0.15)
    assert np.abs(body.positions[0] - drawn).max() < 1e-9


def test_a_block_rests_where_it_is_drawn_in_the_truth_and_in_the_network():
    body = block(3, 0, Scale(), seconds=0.1)
    network = body.network
    assert np.abs(body.positions - network.positions).max() < 1e-4 * body.size_m
    forces = node_forces(network, network.positions, np.zeros_like(network.positions))[network.free]
    assert np.abs(forces).max() < 1e-9 * network.masses.sum() * 9.81
    assert (len(body.marked), len(body.hidden)) == (17, 1)


@pytest.mark.parametrize("per_side", [3])
def test_the_lattice_of_a_block_has_its_youngs_modulus(per_side):
    """Energy of a uniform strain by volume: (lambda/2) tr² + mu tr(e²), nu = 1/4; small strain, 1e-4."""
    body = floating_block(0, Scale(), seconds=0.1)
    network = body.network
    strain = 1e-4 * np.array([[1.0, 0.3, 0.0], [0.3, -0.5, 0.0], [0.0, 0.0, 0.2]])
    energy = potential_energy(network, network.positions @ (np.eye(3) + strain))
    young, volume = 10e3, 0.06**3
    mu = lam = 0.4 * young
    expected = volume * (0.5 * lam * np.trace(strain) ** 2 + mu * (strain**2).sum())
    assert energy == pytest.approx(expected, rel=1e-3)


def test_a_floating_block_has_no_anchor_and_moves_as_a_whole():
    body = floating_block(1, Scale(), seconds=1.0)
    assert not body.network.fixed.any()
    assert (len(body.marked), len(body.hidden)) == (14, 13)
    center = body.positions.mean(axis=1)
    assert 1e-3 < np.linalg.norm(center - center[0], axis=1).max() < 0.03


def test_a_pressed_block_of_a_tenth_of_the_stiffness_is_not_turned_inside_out():
    """Nodes move by less than half the side; a block that everts through its plate moves by more than the side."""
    body = block(3, 4, Scale(stiffness=0.1), seconds=3.0)
    moved = np.linalg.norm(body.positions - body.positions[0], axis=2).max()
    assert 0.005 < moved < 0.03
