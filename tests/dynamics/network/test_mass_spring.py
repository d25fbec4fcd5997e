"""What a network accepts and refuses, and how states are packed."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from dynamics import NetworkError, all_positions, pack, unpack

POSITIONS = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
PER_NODE, PER_SPRING = ("masses", "drag", "friction"), ("stiffness", "rest_lengths", "damping")


@pytest.fixture
def triangle(build):
    """Anchor N0 and free N1, N2, three springs."""
    return build(POSITIONS, [(0, 1), (1, 2), (2, 0)], [0], gravity=[0.0, -9.81])


FAULTS = [
    ({"positions": np.zeros(3)}, ["positions", "(n_nodes, 2) or (n_nodes, 3)", "found (3,)"]),
    ({"names": ("a", "b")}, ["positions", "expected shape (2, 2)", "found (3, 2)"]),
    ({"names": ("a", "b", "a")}, ['node "a"', "unique names", "twice"]),
    *(({key: np.ones(4)}, [key, "expected shape (3,)", "found (4,)"]) for key in PER_NODE + PER_SPRING),
    ({"gravity": [0.0, 0.0, -9.81]}, ["gravity", "expected shape (2,)", "found (3,)"]),
    *(({key: [1.0, np.nan, 1.0]}, [key, "finite", "found nan"]) for key in PER_NODE + PER_SPRING),
    ({"positions": [[0.0, 0.0], [np.inf, 0.0], [1.0, 1.0]]}, ["positions", "finite", "found inf"]),
    ({"gravity": [0.0, -np.inf]}, ["gravity", "finite", "found -inf"]),
    ({"fixed": [True, False]}, ["fixed", "expected shape (3,)", "found (2,)"]),
    ({"fixed": [True, True, True]}, ["fixed", "at least one free node", "none"]),
    ({"masses": [1.0, 0.0, 1.0]}, ['node "N1" mass', "more than 0 kg", "found 0"]),
    ({"masses": [1.0, 1.0, -0.5]}, ['node "N2" mass', "more than 0 kg", "found -0.5"]),
    *(({key: [0.0, 0.0, -2.0]}, [f'node "N2" {key}', "0 or more", "found -2"]) for key in ("drag", "friction")),
    ({"springs": [(0, 1), (1, 0), (0, 1)]}, ['node "N2"', "at least one spring", "none"]),
    ({"springs": [(0, 1), (1, 2), (2, 3)]}, ["spring 2", "nodes 0 to 2", "found 2 and 3"]),
    ({"springs": [(0, 1), (1, 2), (2, 2)]}, ["spring N2-N2", "two different nodes", "found one"]),
    *(({key: [1.0, 0.0, 1.0]}, [f"spring N1-N2 {key}", "more than 0", "found 0"]) for key in PER_SPRING[:2]),
    *(({key: [1.0, 1.0, -3.0]}, [f"spring N2-N0 {key}", "more than 0", "found -3"]) for key in PER_SPRING[:2]),
    ({"damping": [0.0, -0.1, 0.0]}, ["spring N1-N2 damping", "0 or more", "found -0.1"]),
    ({"positions": [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]}, ["spring N1-N2", "different places", "[1. 0.]"]),
]


@pytest.mark.parametrize(
    ("changes", "fragments"), FAULTS, ids=[f"{i}-{next(iter(c))}" for i, (c, _) in enumerate(FAULTS)]
)
def test_a_network_that_cannot_be_simulated_is_refused_by_field_expected_and_found(triangle, changes, fragments):
    # Style, rule 16: the message names the thing, what was expected and what came.
    with pytest.raises(NetworkError) as error:
        replace(triangle, **changes)
    for fragment in fragments:
        assert fragment in str(error.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"springs": [0, 1, 1, 2, 2, 0], "stiffness": np.ones(6), "rest_lengths": np.ones(6), "damping": np.ones(6)},
        {"springs": [(0, 1, 1), (2, 2, 0)], "stiffness": np.ones(2), "rest_lengths": np.ones(2), "damping": np.ones(2)},
        {"springs": [(0, 1, 2)], "stiffness": [1.0], "rest_lengths": [1.0], "damping": [1.0]},
        {"springs": [(0, 1), (1, 2), (2, 0.9)]},
    ],
    ids=["flat", "triples", "one-triple", "halves"],
)
def test_springs_that_are_not_pairs_of_node_numbers_are_refused(triangle, changes):
    # Documented shape: (n_springs, 2) whole numbers; what is not is named, never reshaped or cut off.
    with pytest.raises(NetworkError, match="springs"):
        replace(triangle, **changes)


def test_what_plays_no_part_for_an_anchor_is_not_checked(triangle):
    # Documented: an anchor's mass plays no part, and an anchor needs no spring.
    network = replace(triangle, masses=[0.0, 1.0, 1.0], springs=[(1, 2), (2, 1), (1, 2)])
    assert network.free.tolist() == [1, 2]


def test_a_network_cannot_change_and_shares_no_array_with_its_maker(triangle):
    masses = np.array([1.0, 2.0, 3.0])
    network = replace(triangle, masses=masses)
    masses[1] = -7.0
    assert network.masses.tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(FrozenInstanceError):
        network.masses = masses
    arrays = (*PER_NODE, *PER_SPRING, "positions", "gravity", "fixed", "springs", "free")
    assert not any(getattr(network, key).flags.writeable for key in arrays)


def test_sizes_and_places(triangle):
    assert (triangle.dim, triangle.n_nodes, triangle.n_state) == (2, 3, 8)
    assert [triangle.index(name) for name in ("N0", "N1", "N2")] == [0, 1, 2]
    assert triangle.coordinates("N1") == slice(0, 2)
    assert triangle.coordinates("N2") == slice(2, 4)
    with pytest.raises(NetworkError, match='no node named "N9"'):
        triangle.index("N9")
    with pytest.raises(NetworkError, match='node "N0": expected a free node, found an anchor'):
        triangle.coordinates("N0")


def test_a_state_is_positions_then_velocities_node_major():
    # The order that design.md fixes: x0 y0 x1 y1 ... vx0 vy0 ...
    state = pack([[1.0, 2.0], [3.0, 4.0]], [[5.0, 6.0], [7.0, 8.0]])
    assert state.tolist() == [1, 2, 3, 4, 5, 6, 7, 8]
    state = pack([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], [[7.0, 8.0, 9.0], [10.0, 11.0, 12.0]])
    assert state.tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]


@pytest.mark.parametrize(("x", "v"), [((3, 2), (2, 2)), ((4,), (4,)), ((1, 3, 2), (3, 2))])
def test_pack_refuses_shapes_that_do_not_match(x, v):
    with pytest.raises(ValueError, match="one shape"):
        pack(np.zeros(x), np.zeros(v))


@pytest.mark.parametrize(("length", "dim"), [(6, 2), (8, 3), (13, 2)])
def test_unpack_refuses_a_length_that_is_no_state(length, dim):
    with pytest.raises(ValueError, match=f"length 2 n {dim}, found {length}"):
        unpack(np.zeros(length), dim)


def test_all_positions_leaves_anchors_where_they_stand(triangle):
    free = np.array([[5.0, 6.0], [7.0, 8.0]])
    np.testing.assert_array_equal(all_positions(triangle, free), [[0.0, 0.0], [5.0, 6.0], [7.0, 8.0]])
    np.testing.assert_array_equal(triangle.positions, POSITIONS)
