"""Location of points in a mesh and on its surface, by barycentric weights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynamics.arrays import Floats
from dynamics.mesh.tet_mesh import MeshError, TetMesh

INSIDE = -1e-9
"""A point lies inside an element if none of its barycentric weights is below this [1]; numerical."""


def locate(mesh: TetMesh, points: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Index of the element that contains each point, (k,), and barycentric weights of the element's corners, (k, 4).

    points: positions at rest [m], (k, 3). Raises MeshError for a point outside the mesh.
    """
    elements, weights = nearest_elements(mesh, points)
    for k, (point, own) in enumerate(zip(points, weights, strict=True)):
        if not own.min() >= INSIDE:
            raise MeshError(f"point {k}: expected a place inside the mesh, found {np.round(point, 6)} m")
    return elements, weights


def nearest_elements(mesh: TetMesh, points: Floats) -> tuple[NDArray[np.int64], Floats]:
    """As `locate`, but for any point. The chosen element is the one whose smallest weight at the point is largest."""
    gradients = np.ascontiguousarray(mesh.gradients.transpose(1, 2, 0))
    centres = np.ascontiguousarray(mesh.nodes[mesh.elements].mean(axis=1).T)
    elements, weights = np.empty(len(points), dtype=np.int64), np.empty((len(points), 4))
    for k, point in enumerate(points):
        each = 0.25 + np.einsum("ade,de->ae", gradients, point[:, None] - centres)
        elements[k] = each.min(axis=0).argmax()
        weights[k] = each[:, elements[k]]
    return elements, weights


def locate_on_surface(
    mesh: TetMesh, faces: NDArray[np.int64], points: Floats
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Face nearest to each point, (k,), weights of the face's corners, (k, 3), and distance from the face [m], (k,).

    faces: nodes of each face, (n_faces, 3), as in `surface`; points: positions [m], (k, 3)
    """
    corners, n = mesh.nodes[faces], len(faces)
    edges = corners[:, [1, 2, 0]] - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    normal /= (normal**2).sum(axis=1, keepdims=True)
    found, weights, distances = np.empty(len(points), dtype=np.int64), np.empty((len(points), 3)), np.empty(len(points))
    for k, point in enumerate(points):
        away = point - corners
        # Weights of the corners at the projected point, from triangles of the opposite edges and the point
        below = np.einsum("fcd,fd->fc", np.cross(edges, away)[:, [1, 2, 0]], normal)
        along = np.clip((away * edges).sum(axis=2) / (edges**2).sum(axis=2), 0.0, 1.0)
        candidates = np.zeros((4, n, 3))
        candidates[0] = below
        for edge in range(3):
            candidates[1 + edge, :, edge] = 1.0 - along[:, edge]
            candidates[1 + edge, :, (edge + 1) % 3] = along[:, edge]
        apart = np.linalg.norm(np.einsum("qfc,fcd->qfd", candidates, corners) - point, axis=2)
        apart[0, below.min(axis=1) < 0.0] = np.inf
        q, found[k] = np.unravel_index(apart.argmin(), apart.shape)
        weights[k], distances[k] = candidates[q, found[k]], apart[q, found[k]]
    return found, weights, distances


def far_apart(places: Floats, count: int, first: Sequence[int] | NDArray[np.int64] = (0,)) -> NDArray[np.int64]:
    """Indices of at most `count` places that are far from each other.

    The next place is always the one that is farthest from the places already chosen.
    places: positions [m], (n, 3); first: indices of the places that are chosen first
    """
    chosen = [int(index) for index in first]
    away = np.linalg.norm(places[:, None] - places[chosen], axis=2).min(axis=1)
    while len(chosen) < min(count, len(places)):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return np.array(chosen)
