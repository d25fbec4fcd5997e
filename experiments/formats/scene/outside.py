"""Outer surface of a body in space, for displays: the surface of its mesh, or the convex hull of its network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree, QhullError

from dynamics.mesh import surface
from experiments.arrays import Floats
from experiments.formats.mesh.filled import clustered
from experiments.formats.mesh.project_file import held, mesh_of
from experiments.formats.scene.scene import Scene

FINEST, COARSER = 1.0 / 200.0, 1.25
"""Finest cell size in `fewer` [1], relative to the body's size, and ratio of two successive cell sizes [1]."""


@dataclass(frozen=True, slots=True, eq=False)
class Outside:
    """Outer surface: corners [m], (n, 3), and faces as indices of corners, counter-clockwise from outside, (m, 3)."""

    corners: Floats
    faces: NDArray[np.int64]

    @property
    def normals(self) -> Floats:
        """Outward normals of the faces; the length of each is twice the face's area [m²], (n_faces, 3)."""
        a, b, c = (self.corners[self.faces[:, k]] for k in range(3))
        return np.cross(b - a, c - a)


def outside_of(scene: Scene, most: int) -> Outside:
    """Outer surface of a body, with no more than `most` faces."""
    if scene.mesh is not None:
        mesh = mesh_of(scene.mesh.content, Path(scene.mesh.file)).mesh
        return fewer(_outside(mesh.nodes, surface(mesh).faces), most)
    x = scene.network.positions
    try:
        hull = ConvexHull(x)
    except QhullError:  # flat body
        return _outside(x, np.empty((0, 3), dtype=np.int64))
    faces = hull.simplices.astype(np.int64)
    inward = np.einsum("ni,ni->n", Outside(x, faces).normals, hull.equations[:, :3]) < 0.0
    return fewer(_outside(x, np.where(inward[:, None], faces[:, ::-1], faces)), most)


def wall_faces(scene: Scene, outside: Outside) -> NDArray[np.bool_]:
    """Whether all corners of each face are near fixed nodes of the mesh, (n_faces,)."""
    if scene.mesh is None or not scene.mesh.fixed:
        return np.zeros(len(outside.faces), dtype=bool)
    of = mesh_of(scene.mesh.content, Path(scene.mesh.file))
    used = np.unique(surface(of.mesh).faces)
    nearest = used[KDTree(of.mesh.nodes[used]).query(outside.corners)[1]]
    return np.asarray(np.isin(nearest, held(of, scene.mesh.fixed))[outside.faces].all(axis=1))


def fewer(whole: Outside, most: int) -> Outside:
    """A surface with no more than `most` faces; all corners in one cell of a grid are replaced by their mean."""
    found, cell = whole, FINEST * float(np.ptp(whole.corners, axis=0).max())
    while len(found.faces) > most:
        found = _outside(*clustered(whole.corners, whole.faces, cell))
        cell *= COARSER
    return found


def _outside(places: Floats, faces: NDArray[np.int64]) -> Outside:
    """The surface of these faces. Positions that are not corners of a face are omitted."""
    used, numbered = np.unique(faces, return_inverse=True)
    return Outside(places[used], numbered.reshape(-1, 3))
