"""The rest shape is where forces balance and the tissue stays."""

import numpy as np
import pytest

from dynamics import NetworkError, equilibrium_with_fixed, node_forces, reaches, rest_shape, stiffness_matrix


@pytest.mark.parametrize("dim", [2, 3])
def test_forces_balance_and_the_balance_is_stable(tangled, dim):
    """Sum of forces on each free node is 0 up to rounding of tens of N; K has positive eigenvalues only."""
    network = tangled(dim)
    rest = rest_shape(network)
    force = node_forces(network, rest, np.zeros_like(rest))
    assert np.abs(force[network.fixed]).max() > 0.1
    np.testing.assert_allclose(force[network.free], 0.0, atol=1e-12)
    assert np.linalg.eigvalsh(stiffness_matrix(network, rest))[0] > 0
    np.testing.assert_array_equal(rest[network.fixed], network.positions[network.fixed])


HANGING = [[0.05, 0.0], [0.05, -0.2]], [(0, 1)], [0]
FAR = 0.2 + 5.0 / 80.0
CLOSED_FORMS = {
    # length l = l0 + m g / k
    "heavy": (HANGING, {"masses": 1.5, "stiffness": 30.0, "gravity": [0.0, -1.62]}, 0.0, [0.05, -0.281]),
    # the spring points along weight and held force together, l = l0 + |m g + f| / k: (3, -4) N gives 5/80 m
    "pushed": (HANGING, {"gravity": [0.0, -10.0]}, [[3.0, -2.0]], [0.05 + 0.6 * FAR, -0.8 * FAR]),
}


@pytest.mark.parametrize("case", CLOSED_FORMS)
def test_one_hanging_mass_rests_by_its_closed_form(build, case):
    """1e-14 m: rounding."""
    drawn, changes, force, expected = CLOSED_FORMS[case]
    np.testing.assert_allclose(rest_shape(build(*drawn, **changes), force)[1], expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_of_two_rest_shapes_the_drawn_one_is_meant(build, side):
    """An arch of two springs of 0.25 m over 0.4 m stands at height sqrt(0.25² - 0.2²) = 0.15 m on either side."""
    arch = build([[0.0, 0.0], [0.2, 0.1 * side], [0.4, 0.0]], [(0, 1), (1, 2)], [0, 2], rest_lengths=0.25)
    np.testing.assert_allclose(rest_shape(arch)[1], [0.2, 0.15 * side], rtol=0, atol=1e-14)


UNSTABLE = {
    "a hinge without weight turns freely": ([[0.0, 0.0], [0.0, -0.2]], [(0, 1)], [0], {}),
    "an arch drawn flat": ([[0.0, 0.0], [0.2, 0.0], [0.4, 0.0]], [(0, 1), (1, 2)], [0, 2], {"rest_lengths": 0.25}),
}


@pytest.mark.parametrize("case", UNSTABLE)
def test_no_stable_equilibrium_is_an_error(build, case):
    positions, springs, anchors, changes = UNSTABLE[case]
    with pytest.raises(NetworkError, match="rest shape: expected a stable equilibrium"):
        rest_shape(build(positions, springs, anchors, **changes))


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.0])
def test_what_hangs_bent_from_one_anchor_rests_in_any_direction(build, turn):
    """Two links, the ends of which a third spring holds nearer than straight: at rest, in the plane it was drawn in."""
    across = np.array([np.cos(turn), np.sin(turn), 0.0])
    places = np.array([np.zeros(3), 0.06 * across - [0.0, 0.0, 0.08], [0.0, 0.0, -0.16]])
    bent = build(
        places, [(0, 1), (1, 2), (0, 2)], [0], gravity=[0.0, 0.0, -9.81], rest_lengths=np.array([0.1, 0.1, 0.16])
    )
    rest = rest_shape(bent)
    assert np.abs(node_forces(bent, rest, np.zeros((3, 3)))[1:]).max() < 1e-6
    np.testing.assert_allclose(np.cross(rest[1], across)[2], 0.0, atol=1e-9)
    assert rest[1] @ across > 0.02


@pytest.mark.parametrize("gravity", [0.0, -9.81])
def test_without_an_anchor_it_rests_in_its_own_shape(build, gravity):
    """A pair drawn too long, falling or not: as long as its spring, and neither its middle nor its line has moved."""
    pair = build([[0.0, 0.0], [0.2, 0.1]], [(0, 1)], [], gravity=[0.0, gravity], rest_lengths=0.2)
    rest = rest_shape(pair)
    along = np.array([0.2, 0.1]) / np.hypot(0.2, 0.1)
    np.testing.assert_allclose(rest, [[0.1, 0.05] - 0.1 * along, [0.1, 0.05] + 0.1 * along], rtol=0, atol=1e-9)


def test_what_is_held_stays_and_the_others_balance(phantom):
    """M1 and M3 held 20 mm off: forces on M2 and M4 vanish up to rounding, those on the held ones do not."""
    held = {"M1": phantom.positions[0] + [0.02, 0.0], "M3": phantom.positions[2] + [0.0, 0.02]}
    shape = equilibrium_with_fixed(phantom, held)
    force = node_forces(phantom, shape, np.zeros((7, 2)))
    for node, position in held.items():
        np.testing.assert_array_equal(shape[phantom.index(node)], position)
        assert np.abs(force[phantom.index(node)]).max() > 0.1
    for node in ("M2", "M4"):
        np.testing.assert_allclose(force[phantom.index(node)], 0.0, atol=1e-12)
    np.testing.assert_array_equal(shape[phantom.fixed], phantom.positions[phantom.fixed])


def test_holding_a_node_that_is_not_there_is_an_error(phantom):
    with pytest.raises(NetworkError, match='no node named "M9"'):
        equilibrium_with_fixed(phantom, {"M9": [0.0, 0.0]})


TRIANGLE = [[0.0, 0.0], [0.3, 0.0], [0.0, 0.4], [0.6, 0.0]], [(0, 1), (1, 2), (2, 0), (1, 3)]
CHAIN = [[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [0.3, 0.0], [0.5, 0.0]], [(0, 1), (1, 2), (2, 3), (3, 4)]
TWICE = [[0.0, 0.0], [0.1, 0.0]], [(0, 1), (1, 0)]


@pytest.mark.parametrize(
    ("drawn", "anchors", "rest_lengths", "expected"),
    [
        # springs of 3, 4 and 5 dm in a triangle, one more of 3 dm beyond
        (TRIANGLE, [0], None, [0.0, 0.3, 0.4, 0.6]),
        (TRIANGLE, [0, 3], None, [0.0, 0.3, 0.4, 0.0]),
        # without an anchor the longest way: the ends are 5 dm apart, the third node 3 dm from one of them
        (CHAIN, [], None, [0.5, 0.4, 0.3, 0.3, 0.5]),
        # of two springs side by side the shorter
        (TWICE, [0], [0.2, 0.1], [0.0, 0.1]),
    ],
)
def test_the_reach_of_a_node_is_the_shortest_way_to_an_anchor(build, drawn, anchors, rest_lengths, expected):
    """Against the written-out sum. 1e-15 m: rounding of sums."""
    changes = {} if rest_lengths is None else {"rest_lengths": np.array(rest_lengths)}
    np.testing.assert_allclose(reaches(build(*drawn, anchors, **changes)), expected, rtol=0, atol=1e-15)
