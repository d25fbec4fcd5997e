"""Closed surfaces of triangles: checks, and filling with tetrahedra by fTetWild [hu2020]."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import chdir
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.extras import require

FLATTEST = 1e-8
"""Least area of a triangle, relative to its longest edge squared [1]; numerical: a regular triangle has 0.43."""

EDGES = 20
"""Default number of element edges along the diagonal of a body's bounding box, as in fTetWild."""

LEAST_EDGES, MOST_EDGES = 3.0, 200.0
"""Least and largest number of element edges along the diagonal of a body's bounding box; choice: fewer edges leave no
interior, more edges give millions of nodes."""

ENVELOPE = 0.1
"""Largest distance by which fTetWild may move the surface [1], relative to an element's edge; choice: less than the
error of elements of this size."""

GRID = 0.4
"""Cell size of the grid in `clustered` [1], relative to an element's edge; choice: a surface of 4,340 triangles is
filled in 5 s instead of 40 s, with the same volume to 0.1 %."""


def checked_surface(path: Path, points: Floats, faces: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """Nodes [m], (n, 3), and triangles, (m, 3), of a surface. Corners are counter-clockwise, as seen from outside.

    Corners with equal coordinates are joined, since some formats repeat them for each triangle. If all triangles face
    inward, their node order is reversed. Raises InputError if the surface is not closed, or not in one piece.
    """
    used, place = np.unique(faces, return_inverse=True)
    nodes, joined = np.unique(points[used], axis=0, return_inverse=True)
    faces = joined.ravel()[place.reshape(-1, 3)]
    corners = nodes[faces]
    sides = corners[:, [1, 2, 0]] - corners
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    flat = area <= FLATTEST * (sides**2).sum(axis=2).max(axis=1)
    if flat.any():
        raise InputError.at(path, "no flat triangles", f"{flat.sum()} of {len(flat)}, the first {flat.argmax()}")
    _check_edges(path, nodes, faces)
    ends = (faces[:, [0, 0]].ravel(), faces[:, 1:].ravel())
    parts, part = connected_components(
        coo_array((np.ones(len(ends[0])), ends), shape=(len(nodes),) * 2), directed=False
    )
    if parts > 1:
        sizes = np.sort(np.bincount(part))[::-1][:5].tolist()
        raise InputError.at(path, "one connected surface", f"{parts} parts of {sizes} nodes")
    enclosed = np.einsum("md,md->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return nodes, faces if enclosed > 0.0 else faces[:, ::-1].copy()


def _check_edges(path: Path, nodes: Floats, faces: NDArray[np.int64]) -> None:
    """Raise InputError unless each edge belongs to two triangles that list its ends in opposite order."""
    n = len(nodes)
    ends = np.stack([faces, faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2)
    keys, which, count = np.unique(n * ends.min(axis=1) + ends.max(axis=1), return_inverse=True, return_counts=True)
    if (count == 1).any():
        open_edges = np.stack(np.divmod(keys[count == 1], n))
        rim = coo_array((np.ones(open_edges.shape[1]), tuple(open_edges)), shape=(n, n))
        holes = connected_components(rim, directed=False)[0] - (n - len(np.unique(open_edges)))
        where = np.round(1e3 * nodes[open_edges[0, 0]], 1).tolist()
        raise InputError.at(
            path, "a closed surface", f"{holes} {'hole' if holes == 1 else 'holes'}, one of them at {where} mm"
        )
    if (count > 2).any():
        where = np.round(1e3 * nodes[keys[count > 2][0] // n], 1).tolist()
        raise InputError.at(
            path, "two triangles at each edge", f"more at {(count > 2).sum()} edges, the first at {where} mm"
        )
    turns = np.bincount(which.ravel(), np.where(ends[:, 0] < ends[:, 1], 1, -1))
    if turns.any():
        where = np.round(1e3 * nodes[keys[turns != 0][0] // n], 1).tolist()
        raise InputError.at(
            path,
            "triangles that all face outward",
            f"flipped ones at {(turns != 0).sum()} edges, the first at {where} mm",
        )


def filled(
    path: Path, nodes: Floats, faces: NDArray[np.int64], size_m: float | None
) -> tuple[Floats, NDArray[np.int64]]:
    """Nodes [m] and tetrahedra inside a closed surface; raises InputError.

    size_m: edge length of the elements [m]; by default a twentieth of the bounding box's diagonal
    """
    require(str(path), "mesh")
    diagonal = float(np.linalg.norm(np.ptp(nodes, axis=0)))
    size = diagonal / EDGES if size_m is None else size_m
    if not diagonal / MOST_EDGES <= size <= diagonal / LEAST_EDGES:
        least, most = (1e3 * diagonal / edges for edges in (MOST_EDGES, LEAST_EDGES))
        raise InputError.at("--size-mm", f"{least:.2g} to {most:.3g} mm for {path.name}", f"{1e3 * size:.3g} mm")
    joined, kept = clustered(nodes, faces, GRID * size)
    given = joined, kept.astype(np.int32), size, ENVELOPE * size / diagonal
    try:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as alone:
            points, elements = alone.submit(_by_ftetwild, *given).result()
    except BrokenProcessPool:
        raise InputError.at(path, "a surface that tetrahedra can fill", "one that crashed fTetWild") from None
    if not len(elements):
        raise InputError.at(path, "a surface that tetrahedra can fill", "no tetrahedra from fTetWild")
    used, place = np.unique(elements, return_inverse=True)
    return np.asarray(points, dtype=float)[used], place.reshape(-1, 4)


def _by_ftetwild(
    nodes: Floats, faces: NDArray[np.int32], size_m: float, envelope: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Nodes and tetrahedra from fTetWild; run in a separate process, because fTetWild catches signals."""
    import pytetwild

    with TemporaryDirectory() as folder, chdir(folder):
        points, elements = pytetwild.tetrahedralize(nodes, faces, edge_length_abs=size_m, epsilon=envelope, quiet=True)
    return np.asarray(points, dtype=float), elements.astype(np.int64)


def clustered(nodes: Floats, faces: NDArray[np.int64], side_m: float) -> tuple[Floats, NDArray[np.int64]]:
    """A coarser surface: all points in one cell of a grid are replaced by their mean. `side_m` is the cell size [m].

    Triangles without area are omitted. The others are sorted by cell, which makes fTetWild ten times faster.
    """
    cells = np.unique(np.floor(nodes / side_m).astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    means = np.stack([np.bincount(cells, axis) for axis in nodes.T], axis=1) / np.bincount(cells)[:, None]
    corners = cells[faces]
    corners = corners[(corners != corners[:, [1, 2, 0]]).all(axis=1)]
    first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)[1]
    return means, corners[first]
