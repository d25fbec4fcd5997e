"""Surface of a mesh: its faces, and the areas and normals of their nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynamics.arrays import Floats
from dynamics.mesh.tet_mesh import FACES, TetMesh, face_keys


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Surface of a mesh.

    Attributes
    ----------
    faces : (n_faces, 3) int
        Nodes of each face, counter-clockwise seen from outside.
    nodes : (k,) int
        Nodes of the faces, ascending.
    areas : (k,)
        A third of the area of the faces around each of these nodes [m²].
    normals : (k, 3)
        Outward unit normals of these nodes: the mean normal of their faces, weighted by area.
    """

    faces: NDArray[np.int64]
    nodes: NDArray[np.int64]
    areas: Floats
    normals: Floats


def surface(mesh: TetMesh) -> Surface:
    """Surface of a mesh: the faces that belong to only one element."""
    _, first, count = np.unique(face_keys(mesh.elements, len(mesh.nodes)), return_index=True, return_counts=True)
    faces = mesh.elements[:, FACES].reshape(-1, 3)[np.sort(first[count == 1])]
    a, b, c = (mesh.nodes[faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a) / 6.0
    nodes, place = np.unique(faces, return_inverse=True)
    shares = np.repeat(np.column_stack([np.linalg.norm(across, axis=1), across]), 3, axis=0)
    summed: Floats = np.stack([np.bincount(place.ravel(), share) for share in shares.T], axis=1)
    areas, normals = summed[:, 0], summed[:, 1:]
    return Surface(faces, nodes, areas, normals / np.linalg.norm(normals, axis=1, keepdims=True))
