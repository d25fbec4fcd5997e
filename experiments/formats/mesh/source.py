"""Mesh files of other programs, read by meshio, except OBJ. Unit and order of the nodes remain those of the file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.arrays import Floats
from experiments.errors import InputError, shown
from experiments.extras import require

READERS = {".vtk": "vtk", ".vtu": "vtu", ".msh": "gmsh", ".stl": "stl", ".obj": "obj", ".ply": "ply"}
"""Modules of meshio by file name extension; `_obj` reads OBJ."""

READ = {"vertex": 1, "line": 2, "triangle": 3, "quad": 4, "tetra": 4}
"""Number of nodes of each permitted kind of cell. Points and lines are ignored; quadrilaterals become two triangles."""

HEADER = 600
"""Number of bytes that contain the header of a VTK file; each line of the header has at most 256 characters."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Triangles or tetrahedra.

    nodes: indices of each cell's nodes, counted from 0, (m, 3) or (m, 4)
    fields: the fields by name, each with one number for each cell, (m,)
    """

    nodes: NDArray[np.int64]
    fields: Mapping[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.nodes)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """The content of a mesh file.

    points: positions in the file's unit, (n, 3)
    fields: the fields by name, each with one number for each point, (n,)
    """

    path: Path
    points: Floats
    triangles: Cells
    tetrahedra: Cells
    fields: Mapping[str, Floats]


def read_source(path: Path) -> Source:
    """Read a mesh file; raises InputError for an unreadable file, and for cells of a kind that `READ` does not list."""
    require(str(path), "mesh")
    name = READERS.get(path.suffix.lower())
    if name is None:
        raise InputError.at(path, f"one of {', '.join(READERS)}", path.suffix or "no such ending")
    if not path.is_file():
        raise InputError.at(path, "a file", "a folder" if path.is_dir() else "none")
    try:
        with path.open("rb") as file:
            is_poly = name == "vtk" and b"DATASET POLYDATA" in file.read(HEADER)
        if is_poly:
            raise InputError.at(path, "an unstructured grid; a surface as STL or PLY", "POLYDATA")
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), np.errstate(all="ignore"):
            mesh = _obj(path) if name == "obj" else import_module(f"meshio.{name}").read(str(path))
    except InputError:
        raise
    except OSError as error:
        raise InputError.refused(path, "a file that can be read", error) from error
    except Exception as error:  # the parser may raise any exception
        torn = "neither text nor a whole binary file; it may be truncated"
        fault = torn if isinstance(error, UnicodeDecodeError) else shown(str(error) or type(error).__name__)[1:-1]
        raise InputError.at(path, f"a mesh of {name.upper()}", fault) from None
    points = np.asarray(mesh.points, dtype=float)
    if not len(points):
        raise InputError.at(path, "tetrahedra or triangles", "none; the file may be empty or truncated")
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError.at(path, "points in space", f"numbers of shape {points.shape}")
    for block in mesh.cells:
        if block.type not in READ:
            raise InputError.at(path, "linear tetrahedra, or triangles of a surface", f"{len(block.data)} {block.type}")
    triangles, tetrahedra = _cells(mesh, ("triangle", "quad")), _cells(mesh, ("tetra",))
    for cells in (triangles, tetrahedra):
        if len(cells) and not 0 <= cells.nodes.min() <= cells.nodes.max() < len(points):
            raise InputError.at(
                path, f"nodes 0 to {len(points) - 1} in cells", f"{cells.nodes.min()} to {cells.nodes.max()}"
            )
    return Source(path, points, triangles, tetrahedra, _numbers(mesh.point_data, len(points)))


def _obj(path: Path) -> Any:
    """Points and triangles of an OBJ file, as a mesh of meshio; a polygon becomes triangles around its first corner.

    Only lines `v` and `f` are read. meshio reads neither faces `1//1` nor negative indices, which count from the end.
    """
    points: list[list[float]] = []
    triangles: list[list[int]] = []
    for line in path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ").split("\n"):
        word, *entries = line.split() or [""]
        if word == "v":
            points.append([float(entry) for entry in entries[:3]])
        elif word == "f":
            numbers = [int(entry.partition("/")[0]) for entry in entries]
            first, *others = (number + len(points) if number < 0 else number - 1 for number in numbers)
            triangles += [[first, *pair] for pair in pairwise(others)]
    cells = [("triangle", np.array(triangles))] if triangles else []
    return import_module("meshio").Mesh(np.array(points), cells)


def _cells(mesh: Any, kinds: Sequence[str]) -> Cells:
    """The cells of these kinds in the order of the file; a quadrilateral becomes two triangles."""
    nodes: list[NDArray[np.int64]] = []
    fields: dict[str, list[Floats]] = {name: [] for name in mesh.cell_data}
    for which, block in enumerate(mesh.cells):
        if block.type not in kinds or not len(block.data):
            continue
        corners, twice = np.asarray(block.data, dtype=np.int64), block.type == "quad"
        nodes.append(corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3) if twice else corners)
        for name, parts in mesh.cell_data.items():
            part = np.asarray(parts[which])
            fields[name].append(np.repeat(part, 2, axis=0) if twice else part)
    if not nodes:
        return Cells(np.empty((0, 4 if kinds == ("tetra",) else 3), dtype=np.int64))
    joined = {name: np.concatenate(parts) for name, parts in fields.items() if len({p.shape[1:] for p in parts}) == 1}
    return Cells(np.concatenate(nodes), _numbers(joined, sum(map(len, nodes))))


def _numbers(fields: Mapping[str, Any], n: int) -> dict[str, Floats]:
    """Fields with one number for each of n points or cells; vectors and texts are omitted."""
    kept = {}
    for name, values in fields.items():
        array = np.asarray(values)
        flat = array.reshape(n, -1) if array.size else array
        if array.dtype.kind in "iufb" and flat.ndim == 2 and flat.shape[1] == 1:
            kept[name] = flat[:, 0].astype(float)
    return kept
