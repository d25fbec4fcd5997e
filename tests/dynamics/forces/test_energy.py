"""The forces are the textbook's; `test_laws.py` has them as minus the gradient of the energy."""

import numpy as np
import pytest

from dynamics import kinetic_energy, node_forces, potential_energy
from tests.dynamics.conftest import moved, textbook_force


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("only", [None, "damping", "drag", "friction", "gravity", "springs"])
def test_force_is_the_textbook_one(tangled, dim, only):
    """Equation in `textbook_force`, loops over nodes and springs; each term alone too. 1e-12 of tens of N: rounding."""
    off = {key: 0.0 for key in ("damping", "drag", "friction", "gravity") if only is not None and key != only}
    network = tangled(dim, **off)
    for seed in range(5):
        x, v = moved(network, seed)
        np.testing.assert_allclose(node_forces(network, x, v), textbook_force(network, x, v), rtol=0, atol=1e-12)


def test_a_spring_of_no_length_has_no_force(build):
    """Documented: shorter than 1 nm there is no direction, with any relative speed."""
    pair = build([[0.0, 0.0], [0.2, 0.0]], [(0, 1)], damping=0.5)
    np.testing.assert_allclose(node_forces(pair, np.full((2, 2), 0.1), [[0.0, 0.0], [1.0, -2.0]]), 0.0, atol=1e-13)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("distance", [1e-6, 0.05, 0.25])
def test_a_spring_pulled_through_nothing_pushes_apart_on_the_other_side(build, side, distance):
    """Force k (l0 - l) outward on either side; the length is softened by (1e-9 / l)² / 2 = 5e-7 of it at most."""
    pair = build([[0.0, 0.0], [0.2, 0.0]], [(0, 1)])
    force = node_forces(pair, [[0.0, 0.0], [side * distance, 0.0]], np.zeros((2, 2)))
    outward = side * 80.0 * (0.2 - distance)
    np.testing.assert_allclose(force, [[-outward, 0.0], [outward, 0.0]], rtol=1e-6)


def test_energies_of_one_hanging_mass(build):
    """V = k (l - l0)²/2 + m g h and K = m v²/2: 0.4 - 0.5886 J and 2.5 J; an anchor has neither."""
    hung = build([[0.0, 0.0], [0.0, -0.2]], [(0, 1)], [0], gravity=[0.0, -9.81])
    assert potential_energy(hung, [[0.0, 0.0], [0.0, -0.3]]) == pytest.approx(0.4 - 0.5886, rel=1e-14)
    assert kinetic_energy(hung, [[9.0, 9.0], [3.0, -4.0]]) == pytest.approx(2.5, rel=1e-14)


@pytest.mark.parametrize(("x", "v"), [((4, 2), (5, 2)), ((5, 2), (5, 3)), ((5, 3), (5, 3)), ((2, 5), (2, 5))])
def test_other_shapes_are_refused(tangled, x, v):
    with pytest.raises(ValueError, match=r"shape \(5, 2\)"):
        node_forces(tangled(2), np.zeros(x), np.zeros(v))
