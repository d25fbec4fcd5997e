"""Constants in groups: which are one, what a common factor does to them, and the direction that it is."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics import four_mass_phantom, node_forces, rest_shape, scale_parameters
from estimators import constant_groups, group_label, group_value
from estimators.identification.groups import group_directions, scale_groups, touched
from tests.networks import build_network


def ladder(n=16):
    """Two rows of n masses below n anchors, side springs of 50 N/m, diagonals of 20 N/m, at rest under weight."""
    names = tuple(f"{row}{k}" for row in "abc" for k in range(n))
    positions = np.array([[0.02 * k, -0.02 * row] for row in range(3) for k in range(n)])
    sides = [(row * n + k, (row + 1) * n + k) for row in range(2) for k in range(n)]
    sides += [(row * n + k, row * n + k + 1) for row in (1, 2) for k in range(n - 1)]
    diagonals = [(row * n + k, (row + 1) * n + k + 1) for row in range(2) for k in range(n - 1)]
    stiffness = np.r_[np.full(len(sides), 50.0), np.full(len(diagonals), 20.0)]
    constants = {"masses": 0.01, "drag": 0.1, "stiffness": stiffness, "damping": 0.1, "gravity": [0.0, -9.81]}
    network = build_network(positions, sides + diagonals, range(n), names, **constants)
    return replace(network, positions=rest_shape(network))


def test_each_constant_of_a_small_network_is_a_group_by_itself():
    network = four_mass_phantom()
    groups = constant_groups(network, ("stiffness", "drag"))
    assert [len(group.places) for group in groups] == [1] * 14
    assert group_label(groups[0]) == "stiffness M1-M2"
    assert group_value(network, groups[0]) == pytest.approx(250.0)
    assert touched(groups) == tuple(one for group in groups for one in group.parameters)


def test_springs_of_equal_stiffness_are_a_group_of_a_large_network():
    network = ladder()
    groups = constant_groups(network, ("stiffness", "rest_length", "drag"))
    assert [(group.kind, len(group.places)) for group in groups] == [
        ("stiffness", 62), ("stiffness", 30), ("rest_length", 62), ("rest_length", 30), ("drag", 32),
    ]  # fmt: skip
    assert group_label(groups[0]) == "stiffness 50 N/m (62)"


def test_many_different_stiffnesses_are_one_group():
    network = ladder()
    network = replace(network, stiffness=network.stiffness * np.linspace(0.9, 1.1, len(network.springs)))
    (group,) = constant_groups(network, ("stiffness",))
    assert len(group.places) == len(network.springs)


def test_named_groups_are_what_the_names_say():
    network = four_mass_phantom()
    names = ["skin", "skin", "fat", "", ""] + ["fat"] * 5
    groups = constant_groups(network, ("stiffness",), names)
    assert [(group_label(group), group.places) for group in groups[:2]] == [
        ("stiffness skin (2)", (0, 1)),
        ("stiffness fat (6)", (2, 5, 6, 7, 8, 9)),
    ]
    assert [len(group.places) for group in groups[2:]] == [1, 1]
    with pytest.raises(ValueError, match="spring_groups: expected 10 names, found 2"):
        constant_groups(network, ("stiffness",), names[:2])


def test_a_tissue_that_rests_where_it_is_drawn_does_so_at_any_stiffness():
    """Forces at the drawn shape, zero but for rounding, stay so: springs keep their tension exactly."""
    network = ladder()
    weight = 0.01 * 9.81
    groups = constant_groups(network, ("stiffness",))
    for change in ([0.26, -0.22], [-0.22, 0.26]):
        scaled = scale_groups(network, groups, change)
        np.testing.assert_allclose(scaled.stiffness / network.stiffness, np.exp(np.repeat(change, (62, 30))))
        forces = node_forces(scaled, network.positions, np.zeros_like(network.positions))[network.free]
        assert np.abs(forces).max() < 1e-6 * weight
    plain = scale_parameters(network, [one for group in groups for one in group.parameters], np.full(92, 0.26))
    left = node_forces(plain, network.positions, np.zeros_like(network.positions))[network.free]
    assert np.abs(left).max() > 0.1 * weight


def test_a_factor_of_several_rest_lengths_is_omitted_if_the_shape_was_measured_at_rest():
    """A factor of one rest length stays, since single rest lengths follow single stiffnesses."""
    kinds = ("stiffness", "rest_length")
    found = constant_groups(ladder(), kinds, rests_as_drawn=True)
    assert found == constant_groups(ladder(), ("stiffness",))
    single = constant_groups(four_mass_phantom(), kinds, rests_as_drawn=True)
    assert single == constant_groups(four_mass_phantom(), kinds)


def test_directions_are_the_slope_of_the_scaling():
    """Against a central difference of the logs of all constants: truncation 1e-10."""
    network = ladder()
    groups = constant_groups(network, ("stiffness", "rest_length", "damping"))
    which = touched(groups)
    directions = group_directions(network, groups, which)

    def logs(change):
        scaled = scale_groups(network, groups, change)
        values = {"stiffness": scaled.stiffness, "rest_length": scaled.rest_lengths, "damping": scaled.damping}
        return np.log([values[one.kind][one.index] for one in which])

    for row, e in zip(directions, np.eye(len(groups)), strict=True):
        slope = (logs(1e-5 * e) - logs(-1e-5 * e)) / 2e-5
        np.testing.assert_allclose(row, slope, rtol=0, atol=1e-9)
