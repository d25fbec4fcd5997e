"""The phantom is the paper's in shape, symmetric, and stays the right way up."""

import numpy as np
import pytest

from dynamics import HIDDEN, OUTER, Stepper, node_forces, pack, rest_shape, state_matrix

MIRRORED = {"M1": "M4", "M2": "M2", "M3": "M3", "In1": "In3", "In2": "In2"}
MIRRORED |= {b: a for a, b in MIRRORED.items()}


def test_nodes_are_the_papers(phantom):
    """[paper] Fig. 3: four masses, of which M2 is hidden, on three points of the floor."""
    assert phantom.names == ("M1", "M2", "M3", "M4", "In1", "In2", "In3")
    assert (OUTER, HIDDEN) == (("M1", "M3", "M4"), "M2")
    assert [phantom.names[i] for i in phantom.free] == ["M1", "M2", "M3", "M4"]
    np.testing.assert_allclose(phantom.positions[phantom.fixed], [[-0.2, 0.0], [0.0, 0.0], [0.2, 0.0]], atol=1e-15)


def test_it_is_drawn_at_rest_and_the_rest_is_stable(phantom):
    """Forces balance up to rounding, and every eigenvalue of the linearised motion fades (Re lambda < 0)."""
    np.testing.assert_allclose(rest_shape(phantom), phantom.positions, rtol=0, atol=1e-14)
    force = node_forces(phantom, phantom.positions, np.zeros((7, 2)))
    np.testing.assert_allclose(force[phantom.free], 0.0, atol=1e-12)
    # The floor bears it all: four masses of 0.2 kg.
    np.testing.assert_allclose(-force[phantom.fixed].sum(axis=0), [0.0, 4 * 0.2 * 9.81], atol=1e-12)
    assert np.linalg.eigvals(state_matrix(phantom, phantom.positions)).real.max() < -5.0


@pytest.mark.parametrize("node", OUTER)
def test_a_poke_of_10_m_s2_for_400_ms_does_not_turn_it_over(phantom, node):
    """Chosen strength: after a poke in any of 16 directions it comes back to the same rest shape."""
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    push = 10.0 * 0.2 * np.column_stack([np.cos(angles), np.sin(angles)])
    rest = pack(phantom.positions[phantom.free], np.zeros((4, 2)))
    states, stepper, farthest, dt = np.tile(rest, (16, 1)), Stepper(phantom), 0.0, 1.0 / 120.0
    for _ in range(48):
        forces = np.zeros((16, 8))
        forces[:, phantom.coordinates(node)] = push
        states = stepper.advance(states, dt, forces)
        farthest = max(farthest, np.abs(states - rest)[:, :8].max())
    assert farthest > 0.01
    np.testing.assert_allclose(stepper.advance(states, 10.0), np.tile(rest, (16, 1)), rtol=0, atol=1e-9)
