"""Elbows to the left and to the right: all shapes in which the part between fixed nodes can rest."""

import numpy as np
import pytest

from dynamics import NetworkError, equilibrium_with_fixed, mirrored_shapes, node_forces, potential_energy

ELBOW = [[0.0, 0.0], [0.06, -0.05], [0.12, 0.0]]
"""An anchor, a joint and an end; the joint hangs below the line between them [m]."""


def test_a_joint_without_weight_may_be_on_either_side(build):
    """By symmetry the other shape is the mirror image, of the same energy. 1e-9 m: what Newton leaves."""
    links = build(ELBOW, [(0, 1), (1, 2)], [0], gravity=[0.0, 0.0])
    places = {links.names[2]: ELBOW[2]}
    shape = equilibrium_with_fixed(links, places)
    ((energy, other),) = mirrored_shapes(links, places, shape)
    np.testing.assert_allclose(other, shape * [1.0, -1.0], rtol=0, atol=1e-9)
    assert energy == pytest.approx(0.0, abs=1e-9)


def test_a_joint_above_has_the_energy_of_its_height(build):
    """Links of 1e6 N/m hardly stretch: m g times twice the depth more than below, 0.2 kg 9.81 m/s² 0.1 m; 0.1 %."""
    links = build(ELBOW, [(0, 1), (1, 2)], [0], masses=0.2, stiffness=1e6, gravity=[0.0, -9.81])
    places = {links.names[2]: ELBOW[2]}
    ((energy, other),) = mirrored_shapes(links, places, equilibrium_with_fixed(links, places))
    assert other[1, 1] == pytest.approx(0.05, abs=1e-4)
    assert energy == pytest.approx(0.2 * 9.81 * 0.1, rel=1e-3)


def test_each_part_between_fixed_nodes_is_mirrored_by_itself(build):
    """Two elbows in a row, the node between them fixed: two other shapes, each with one elbow up; forces balance."""
    zigzag = [[0.0, 0.0], [0.06, -0.05], [0.12, 0.0], [0.18, -0.05], [0.24, 0.0]]
    links = build(zigzag, [(0, 1), (1, 2), (2, 3), (3, 4)], [0], gravity=[0.0, -9.81], masses=0.01)
    places = {links.names[2]: zigzag[2], links.names[4]: zigzag[4]}
    shape = equilibrium_with_fixed(links, places)
    found = mirrored_shapes(links, places, shape)
    up = [tuple(other[[1, 3], 1] > 0.0) for _, other in found]
    assert sorted(up) == [(False, True), (True, False)]
    for energy, other in found:
        left = node_forces(links, other, np.zeros_like(other))[[1, 3]]
        np.testing.assert_allclose(left, 0.0, atol=1e-8)
        assert energy == pytest.approx(potential_energy(links, other) - potential_energy(links, shape), abs=1e-12)


def test_what_braces_keep_in_shape_has_no_other(phantom):
    """The hidden mass of the phantom hangs between more than two fixed nodes, of three marks or of one."""
    for nodes in (("M1", "M3", "M4"), ("M1", "M4"), ("M3",)):
        places = {node: phantom.positions[phantom.index(node)] + [0.01, -0.02] for node in nodes}
        assert mirrored_shapes(phantom, places, equilibrium_with_fixed(phantom, places)) == []


def test_a_side_without_rest_is_left_out(build, monkeypatch):
    """Where no equilibrium is found from the mirrored shape there is no other, and no error."""
    links = build(ELBOW, [(0, 1), (1, 2)], [0], gravity=[0.0, 0.0])
    places = {links.names[2]: ELBOW[2]}
    shape = equilibrium_with_fixed(links, places)

    def no_rest(*_args):
        raise NetworkError("rest shape: expected a stable equilibrium near the drawn shape, found none")

    monkeypatch.setattr("dynamics.equilibrium.mirrored.equilibrium_with_fixed", no_rest)
    assert mirrored_shapes(links, places, shape) == []
