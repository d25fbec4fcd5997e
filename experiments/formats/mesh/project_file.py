"""Mesh file of a scene, in NumPy's format, and selection of the mesh's fixed nodes."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynamics.mesh import MeshError, TetMesh
from experiments.arrays import Floats
from experiments.errors import InputError, placed, shown

ARRAYS = {"nodes_m": "f", "elements": "i", "regions": "i", "wall": "i"}
"""Arrays of the file, and the kind of each array's data type in NumPy."""

PLANE = re.compile(r"([xyz])\s*([<>])\s*(-?\d+(?:\.\d*)?)")
REGION = re.compile(r"region\s+(-?\d+)")
WALL = "wall"

FORMS = '"y < 6" [mm], "region 3" or "wall"'
"""Permitted forms of the key `fixed`, for messages."""


@dataclass(frozen=True, slots=True, eq=False)
class ProjectMesh:
    """The mesh of a scene. `wall` has the indices of the nodes that the source file labels as fixed, (k,)."""

    mesh: TetMesh
    wall: NDArray[np.int64]


def mesh_content(of: ProjectMesh) -> bytes:
    """The content of a mesh file; the same mesh gives the same bytes."""
    mesh, file = of.mesh, io.BytesIO()
    elements, regions, wall = (whole.astype(np.int32) for whole in (mesh.elements, mesh.regions, of.wall))
    np.savez_compressed(file, nodes_m=mesh.nodes, elements=elements, regions=regions, wall=wall)
    return file.getvalue()


def mesh_of(content: bytes, path: Path) -> ProjectMesh:
    """The mesh in the content of a file; raises InputError with the path if the content is invalid."""
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


def extents(places: Floats) -> str:
    """Text with the extent of these positions along each axis, rounded to four figures of the largest one."""
    digits = 4 - int(np.ceil(np.log10(1e3 * np.ptp(places, axis=0).max())))
    ends = np.round(1e3 * np.array([places.min(axis=0), places.max(axis=0)]), digits) + 0.0  # no -0
    return ", ".join(f"{axis} is {low:g} to {high:g} mm" for axis, low, high in zip("xyz", *ends, strict=True))


def beyond(places: Floats, plane: re.Match[str]) -> NDArray[np.int64]:
    """Indices of the positions that satisfy an inequality such as `y < 6` [mm], (k,) int.

    places: positions [m], (n, 3); plane: match of `PLANE`
    """
    along = 1e3 * places[:, "xyz".index(plane[1])]
    return np.flatnonzero(along < float(plane[3]) if plane[2] == "<" else along > float(plane[3]))


def held(of: ProjectMesh, fixed: str) -> NDArray[np.int64]:
    """Indices of the nodes that the text `fixed` selects, (k,) int.

    Raises ValueError, `expected …, found …`, if the text has none of the FORMS, or selects all nodes or fewer than 3.
    """
    mesh = of.mesh
    if plane := PLANE.fullmatch(fixed.strip()):
        nodes = beyond(mesh.nodes, plane)
    elif region := REGION.fullmatch(fixed.strip()):
        nodes = np.unique(mesh.elements[mesh.regions == int(region[1])])
    elif fixed.strip() == WALL:
        nodes = np.asarray(of.wall)
    else:
        raise ValueError(f"expected {FORMS}, found {shown(fixed)}")
    if not 3 <= len(nodes) < len(mesh.nodes):
        found = f"{len(nodes)} of {len(mesh.nodes)}; {extents(mesh.nodes)}"
        raise ValueError(f"expected 3 nodes or more, and not all, found {found}")
    return nodes
