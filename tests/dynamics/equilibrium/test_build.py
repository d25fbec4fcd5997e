"""Networks from names, positions and edges: what they are, where they rest, and which edge or node does not fit."""

import numpy as np
import pytest

from dynamics import NetworkError, build_network, four_mass_phantom, node_forces, rest_shape

G = np.array([0.0, -9.81])
NAMES = ("left", "right", "ball")
PLACES = [[-0.1, 0.0], [0.1, 0.0], [0.0, -0.1]]
EDGES = [("left", "ball"), ("right", "ball")]


def build(**changes):
    """A ball of 0.2 kg that hangs from two anchors."""
    given = {
        "names": NAMES,
        "positions": PLACES,
        "edges": EDGES,
        "stiffness": 100.0,
        "masses": 0.2,
        "gravity": G,
        "fixed": ["left", "right"],
        **changes,
    }
    return build_network(given.pop("names"), given.pop("positions"), given.pop("edges"), **given)


def test_it_is_the_phantom_whose_values_it_is_given():
    phantom = four_mass_phantom()
    built = build_network(
        phantom.names,
        phantom.positions,
        [(phantom.names[i], phantom.names[j]) for i, j in phantom.springs],
        stiffness=250.0,
        masses=0.2,
        gravity=[0.0, -9.81],
        fixed=["In1", "In2", "In3"],
        damping=0.6,
        drag=phantom.drag,
        friction=phantom.friction,
        rest_lengths=phantom.rest_lengths,
    )
    for field in ("names", "positions", "masses", "fixed", "drag", "friction", "springs"):
        np.testing.assert_array_equal(getattr(built, field), getattr(phantom, field))
    for field in ("stiffness", "rest_lengths", "damping", "gravity"):
        np.testing.assert_array_equal(getattr(built, field), getattr(phantom, field))


def test_it_rests_where_it_is_drawn():
    """Closed form: each spring bears m g / (2 cos 45°) and is shorter at rest by that over its stiffness."""
    network = build()
    np.testing.assert_allclose(rest_shape(network), PLACES, rtol=0, atol=1e-12)
    tension = 0.2 * 9.81 / np.sqrt(2.0)
    np.testing.assert_allclose(network.rest_lengths, np.sqrt(0.02) - tension / 100.0, rtol=1e-9)
    assert np.abs(node_forces(network, network.positions, np.zeros((3, 2)))[2]).max() < 1e-9


def test_as_drawn_it_sags():
    network = build(rest_lengths="as drawn")
    np.testing.assert_allclose(network.rest_lengths, np.sqrt(0.02), rtol=1e-12)
    assert rest_shape(network)[2, 1] < -0.1 - 5e-3


@pytest.mark.parametrize("changes", [{"fixed": (), "masses": [0.1, 0.1, 0.3]}, {"gravity": [0.0, 0.0]}])
def test_without_weight_it_rests_as_drawn(changes):
    np.testing.assert_allclose(build(**changes).rest_lengths, np.sqrt(0.02), rtol=1e-12)


def test_values_for_each_and_ends_by_place_in_space():
    network = build(
        positions=np.column_stack([PLACES, [0.0, 0.01, 0.02]]),
        edges=np.array([[0, 2], [1, 2]]),
        stiffness=[100.0, 300.0],
        masses=[0.0, 0.0, 0.2],
        damping=(0.1, 0.2),
        gravity=[0.0, 0.0, 0.0],
    )
    assert network.dim == 3
    np.testing.assert_array_equal(network.springs, [[0, 2], [1, 2]])
    np.testing.assert_array_equal(network.stiffness, [100.0, 300.0])
    np.testing.assert_array_equal(network.masses, [0.0, 0.0, 0.2])
    np.testing.assert_array_equal(network.damping, [0.1, 0.2])
    np.testing.assert_array_equal(network.fixed, [True, True, False])


FAULTS = [
    ({"edges": [("left", "ball"), ("right", "bal")]}, 'edges[1] (right-bal): no node named "bal"'),
    ({"edges": [(0, 2), (1, 3)]}, "edges[1] (1-3): expected nodes 0 to 2, found 3"),
    ({"edges": [(0, 2), (1, 2.0)]}, "edges[1] (1-2.0): expected the name or the place of a node, found 2.0"),
    ({"edges": [("left", "ball"), ("right",)]}, "edges[1] (right): expected two nodes, found 1"),
    ({"edges": [("left", "ball"), ("ball", 2)]}, "edges[1] (ball-2): expected two different nodes, found one"),
    ({"edges": [*EDGES, ("ball", "left")]}, "edges[2] (ball-left): expected each pair once, found it as edges[0], too"),
    ({"edges": [0, 2]}, "edges[0] (0): expected two nodes, found 1"),
    ({"names": ("left", "left", "ball")}, 'node "left": expected unique names, found it as names[0] and names[1]'),
    ({"names": "abc"}, 'names: expected a list of names, found the text "abc"'),
    ({"names": ("left", 1, "ball")}, "names[1]: expected a text, found 1"),
    ({"names": ("left", "ball")}, "positions: expected one for each of 2 nodes, found shape (3, 2)"),
    ({"positions": [0.0, 1.0, 2.0]}, "positions: expected one for each of 3 nodes, found shape (3,)"),
    ({"positions": [[0.0, 1.0], [2.0], [3.0, 4.0]]}, "positions: expected numbers, found [[0.0, 1.0], [2.0],"),
    ({"positions": [[np.nan, 0.0], *PLACES[1:]]}, "positions: expected finite numbers, found nan"),
    ({"fixed": ["left", "top"]}, 'fixed: no node named "top"'),
    ({"fixed": "left"}, 'fixed: expected a list of names, found the text "left"'),
    ({"fixed": NAMES}, "fixed: expected at least one free node, found none"),
    ({"stiffness": [1.0, 2.0, 3.0]}, "stiffness: expected one number or one for each of 2 edges, found shape (3,)"),
    ({"stiffness": "stiff"}, "stiffness: expected numbers, found 'stiff'"),
    ({"masses": [1.0, 2.0]}, "masses: expected one number or one for each of 3 nodes, found shape (2,)"),
    ({"masses": 0.0}, 'node "ball" mass: expected more than 0 kg, found 0'),
    ({"rest_lengths": "drawn"}, 'rest_lengths: expected "at rest", "as drawn" or numbers, found "drawn"'),
    (
        {"edges": [("left", "ball")], "stiffness": 400.0},
        'node "ball": expected springs that let it rest where it is drawn, found its rest ',
    ),
    ({"stiffness": 1.0}, "rest_length left-ball: expected to rest where it was seen with a change below"),
]


@pytest.mark.parametrize(("changes", "message"), FAULTS, ids=[message[:40] for _, message in FAULTS])
def test_what_does_not_fit_is_named(changes, message):
    with pytest.raises(NetworkError) as error:
        build(**changes)
    assert str(error.value).startswith(message)
