"""Material coordinates: distances in the body itself, however it is drawn."""

import numpy as np

from dynamics import material_coordinates
from tests.networks import build_network


def distances(places: np.ndarray) -> np.ndarray:
    return np.linalg.norm(places[:, None] - places, axis=2)


def test_a_bent_cable_is_a_line_of_its_own_length() -> None:
    """Half a circle of radius 1: twelve links of 2 sin(pi / 24), whose material coordinates are their sums."""
    angles = np.linspace(0.0, np.pi, 13)
    cable = build_network(np.column_stack([np.cos(angles), np.sin(angles)]), [(k, k + 1) for k in range(12)], [0])
    found = material_coordinates(cable)
    assert found.shape == (13, 1)
    along = 2.0 * np.sin(np.pi / 24.0) * np.arange(13)
    np.testing.assert_allclose(distances(found), distances(along[:, None]), atol=1e-9)


def test_a_tetrahedron_whose_nodes_are_all_joined_keeps_its_shape() -> None:
    """Ways along springs are then the distances themselves, and classical scaling is exact (torgerson1952)."""
    places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.9, 0.0], [0.3, 0.3, 0.8]])
    body = build_network(places, [(i, j) for i in range(4) for j in range(i)], [])
    found = material_coordinates(body)
    assert found.shape == (4, 3)
    np.testing.assert_allclose(distances(found), distances(places), atol=1e-9)
