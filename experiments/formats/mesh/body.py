"""Bodies of tetrahedra from mesh files, with checks of unit, elements and surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dynamics.mesh import MeshError, TetMesh, surface
from experiments.arrays import Floats
from experiments.errors import InputError, placed
from experiments.formats.mesh.filled import checked_surface, filled
from experiments.formats.mesh.source import Cells, Source, read_source

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
"""Metres per unit of length."""

SMALLEST_M, LARGEST_M = 0.02, 1.0
"""Permitted extent of a body along its longest axis [m]; choice: phantoms of 20 mm and trunks of 1 m are permitted. A
wrong unit changes the extent by a factor of ten or more."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A body of tetrahedra, with the data fields of its file.

    fields: data of the nodes by name, (n,); cell_fields: data of the elements by name, (m,)
    faces: the outer faces, with the file's data for triangles. The data are NaN for faces that the file does not list.
    """

    mesh: TetMesh
    fields: Mapping[str, Floats]
    cell_fields: Mapping[str, Floats]
    faces: Cells


def read_body(
    path: Path,
    unit: str | None,
    size_m: float | None = None,
    check: Callable[[Floats, Body | None], None] = lambda _places, _body: None,
) -> Body:
    """Read the body of a mesh file; raises InputError for the first fault.

    unit: unit of the file, a key of `UNITS`
    size_m: edge length of new elements [m]; None to use the elements of the file
    check: called before new elements are created; arguments: nodes [m], (n, 3), and the body (None for a surface)
    """
    source = read_source(path)
    if not len(source.tetrahedra) and not len(source.triangles):
        raise InputError.at(path, "tetrahedra, or triangles of a closed surface", "none")
    scale = _metres(source, unit)
    if not len(source.tetrahedra):
        check(scale * source.points[np.unique(source.triangles.nodes)], None)
        nodes, faces = checked_surface(path, scale * source.points, source.triangles.nodes)
        mesh = tetrahedra(path, *filled(path, nodes, faces, size_m))
        return Body(mesh, {}, {}, Cells(surface(mesh).faces))
    body = _volume(source, scale)
    check(body.mesh.nodes, body)
    return body if size_m is None else _coarser(path, body, size_m)


def _metres(source: Source, unit: str | None) -> float:
    """Metres per unit of the file; InputError without a unit, or if the body would be too small or too large."""
    used = np.unique((source.tetrahedra if len(source.tetrahedra) else source.triangles).nodes)
    points = source.points[used]
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        first = int(used[np.flatnonzero(~finite)[0]])
        raise InputError.at(source.path, "finite coordinates", f"{(~finite).sum()} without, the first node {first}")
    extent = float(np.ptp(points, axis=0).max())
    if unit is None:
        each = ", ".join(f"{_length(extent * metres)} in {name}" for name, metres in UNITS.items())
        raise InputError.at("--unit", f"the unit of {source.path.name}, {', '.join(UNITS)}", f"none; it is {each}")
    if not SMALLEST_M <= extent * UNITS[unit] <= LARGEST_M:
        raise InputError.at(
            source.path,
            f"a body of {_length(SMALLEST_M)} to {_length(LARGEST_M)}",
            f"{_length(extent * UNITS[unit])} with --unit {unit}",
        )
    return UNITS[unit]


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 1.0 else f"{1e3 * metres:.3g} mm"


def _volume(source: Source, scale: float) -> Body:
    """The body of a file of tetrahedra, without unused nodes."""
    used, place = np.unique(source.tetrahedra.nodes, return_inverse=True)
    mesh = tetrahedra(source.path, scale * source.points[used], place.reshape(-1, 4))
    row = np.full(len(source.points), -1)
    row[used] = np.arange(len(used))
    return Body(
        mesh,
        {name: values[used] for name, values in source.fields.items()},
        source.tetrahedra.fields,
        _outside(mesh, row[source.triangles.nodes], source.triangles.fields),
    )


def _outside(mesh: TetMesh, labelled: NDArray[np.int64], fields: Mapping[str, Floats]) -> Cells:
    """The outer faces, with the file's data for triangles. The data are NaN for faces that the file does not list."""
    faces, n = surface(mesh).faces, len(mesh.nodes)
    keys, given = (
        (corners[:, 0] * n + corners[:, 1]) * n + corners[:, 2] for corners in (np.sort(faces), np.sort(labelled))
    )
    _, at, found = np.intersect1d(keys, given, return_indices=True)
    outer = {name: np.full(len(faces), np.nan) for name in fields}
    for name, values in fields.items():
        outer[name][at] = values[found]
    return Cells(faces, outer)


def tetrahedra(path: Path, nodes: Floats, elements: NDArray[np.int64]) -> TetMesh:
    """The mesh of nodes [m] and elements; if all elements are flipped, their node order is reversed.

    Raises InputError for a mesh that cannot be used.
    """
    if (np.linalg.det(nodes[elements[:, 1:]] - nodes[elements[:, :1]]) < 0.0).all():
        elements = elements[:, [0, 2, 1, 3]]
    with placed(path, MeshError):
        return TetMesh(nodes, elements)


def _coarser(path: Path, body: Body, size_m: float) -> Body:
    """The body with new elements whose edges have this length [m].

    A new element or face gets the data of the nearest old one. Each old node is assigned to the nearest new node.
    A new node gets the mean of its assigned old nodes. Without assigned nodes it gets the data of the nearest old node.
    """
    outside = surface(body.mesh)
    corners, place = np.unique(outside.faces, return_inverse=True)
    mesh = tetrahedra(path, *filled(path, body.mesh.nodes[corners], place.reshape(-1, 3), size_m))
    of_new = cKDTree(mesh.nodes).query(body.mesh.nodes)[1]
    nearest = cKDTree(body.mesh.nodes).query(mesh.nodes)[1]
    count = np.bincount(of_new, minlength=len(mesh.nodes))
    fields = {
        name: np.where(
            count > 0, np.bincount(of_new, values, minlength=len(count)) / np.maximum(count, 1), values[nearest]
        )
        for name, values in body.fields.items()
    }
    old, new = (one.nodes[one.elements].mean(axis=1) for one in (body.mesh, mesh))
    of_element = cKDTree(old).query(new)[1]
    faces = surface(mesh).faces
    of_face = cKDTree(body.mesh.nodes[body.faces.nodes].mean(axis=1)).query(mesh.nodes[faces].mean(axis=1))[1]
    return Body(
        mesh,
        fields,
        {name: values[of_element] for name, values in body.cell_fields.items()},
        Cells(faces, {name: values[of_face] for name, values in body.faces.fields.items()}),
    )
