"""Mesh file of a scene, in NumPy's format: nodes, elements, regions and the nodes of a wall."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynamics.mesh import MeshError, TetMesh
from experiments.errors import InputError, placed, shown

ARRAYS = {"nodes_m": "f", "elements": "i", "regions": "i", "wall": "i"}
"""Arrays of the file, and the kinds of their numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class ProjectMesh:
    """The mesh of a scene; wall: indices of nodes that the source file labels as fixed, (k,), possibly none."""

    mesh: TetMesh
    wall: NDArray[np.int64]


def mesh_content(of: ProjectMesh) -> bytes:
    """The content of a mesh file; the same mesh gives the same bytes."""
    mesh, file = of.mesh, io.BytesIO()
    elements, regions, wall = (whole.astype(np.int32) for whole in (mesh.elements, mesh.regions, of.wall))
    np.savez_compressed(file, nodes_m=mesh.nodes, elements=elements, regions=regions, wall=wall)
    return file.getvalue()


def mesh_of(content: bytes, path: Path) -> ProjectMesh:
    """The mesh in the content of a file; raises InputError with the path if it is invalid."""
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {key: file[key] for key in ARRAYS if key in file.files}
    except Exception as error:  # raised for a file in another format than NumPy's
        raise InputError.at(path, "the mesh of softaim new", shown(str(error) or type(error).__name__)[1:-1]) from None
    for key, kind in ARRAYS.items():
        if key not in arrays or arrays[key].dtype.kind != kind:
            raise InputError.at(path, f"an array {key} of the mesh of softaim new", "none")
    with placed(path, MeshError):
        mesh = TetMesh(arrays["nodes_m"], arrays["elements"].astype(np.int64), arrays["regions"].astype(np.int64))
    wall = arrays["wall"].astype(np.int64)
    if wall.ndim != 1 or (len(wall) and not 0 <= wall.min() <= wall.max() < len(mesh.nodes)):
        raise InputError.at(path, f"node numbers 0 to {len(mesh.nodes) - 1} in wall", "others")
    return ProjectMesh(mesh, wall)
