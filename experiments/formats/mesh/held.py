"""Selection of a mesh's fixed nodes: beyond a plane, in a region, or labelled as wall in the mesh file."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.errors import shown
from experiments.formats.mesh.project_file import ProjectMesh

PLANE = re.compile(r"([xyz])\s*([<>])\s*(-?\d+(?:\.\d*)?)")
REGION = re.compile(r"region\s+(-?\d+)")
WALL = "wall"

FORMS = '"y < 6" [mm], "region 3" or "wall"'
"""Forms of `fixed`, for messages."""


def extents(places: Floats) -> str:
    """Text with the extent of these positions along each axis."""
    ends = zip("xyz", 1e3 * places.min(axis=0), 1e3 * places.max(axis=0), strict=True)
    return ", ".join(f"{axis} is {low:.4g} to {high:.4g} mm" for axis, low, high in ends)


def beyond(places: Floats, plane: re.Match[str]) -> NDArray[np.int64]:
    """Indices of the positions [m], (n, 3), beyond a plane of the form `PLANE`, (k,) int."""
    along = 1e3 * places[:, "xyz".index(plane[1])]
    return np.flatnonzero(along < float(plane[3]) if plane[2] == "<" else along > float(plane[3]))


def held(of: ProjectMesh, fixed: str) -> NDArray[np.int64]:
    """Indices of the nodes that `fixed` selects, (k,) int; ValueError, `expected …, found …`, for none or all."""
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
