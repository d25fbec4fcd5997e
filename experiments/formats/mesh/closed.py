"""Test whether a surface of triangles encloses a body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from experiments.arrays import Floats
from experiments.errors import InputError

FLATTEST = 1e-8
"""Least area of a triangle, relative to its longest edge squared [1]; numerical: a regular triangle has 0.43."""


def checked_surface(path: Path, points: Floats, faces: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """Nodes [m], (n, 3), and triangles, (m, 3), counter-clockwise from outside, of a closed surface in one piece.

    Corners with equal coordinates are joined, since some formats repeat them for each triangle. If all triangles face
    inward, their node order is reversed. Raises InputError.
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
    """Raise InputError unless each edge belongs to two triangles, which run along it in opposite directions."""
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
