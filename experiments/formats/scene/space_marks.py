"""Marks on the skin of a body in space: their normals, and their images in a camera."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from dynamics import MassSpringNetwork
from dynamics.mesh import locate_on_surface, surface
from experiments.arrays import Floats
from experiments.formats.mesh.project_file import mesh_of
from experiments.formats.scene.marks import Mark
from experiments.formats.scene.scene import Scene
from vision import SpaceCamera

TOWARD = (0.0, 0.0, 1.0)
"""Unit normal of reference marks: they are parallel to the calibration board that defined the axes."""


def outward(scene: Scene, nodes: Sequence[str]) -> Floats:
    """Outward unit normals of the marks on these nodes, (n, 3), in the drawn shape of the mesh or network."""
    network = scene.network
    if scene.mesh is None:
        return _out_of_hull(network, nodes)
    places = network.positions[[network.index(node) for node in nodes]]
    return _out_of_mesh(scene.mesh.content, scene.mesh.file, tuple(map(tuple, places.tolist())))


@lru_cache(maxsize=8)
def _out_of_mesh(content: bytes, file: str, places_m: tuple[tuple[float, ...], ...]) -> Floats:
    """Unit normals of a mesh's surface near these positions [m], (n, 3), interpolated between the nodes of a face."""
    mesh = mesh_of(content, Path(file)).mesh
    skin, normals = surface(mesh), np.zeros((len(mesh.nodes), 3))
    normals[skin.nodes] = skin.normals
    face, weights, _ = locate_on_surface(mesh, skin.faces, np.array(places_m).reshape(-1, 3))
    found = np.einsum("nc,ncd->nd", weights, normals[skin.faces[face]])
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _out_of_hull(network: MassSpringNetwork, nodes: Sequence[str]) -> Floats:
    """Normals of the convex hull of the body as drawn.

    A corner has the area-weighted mean of its facets' normals. Nodes inside the hull have the nearest facet's normal.
    """
    x, rows = network.positions, [network.index(node) for node in nodes]
    try:
        hull = ConvexHull(x)
    except QhullError:  # flat body
        _, _, axes = np.linalg.svd(x - x.mean(axis=0))
        return np.tile(axes[2] * (1.0 if axes[2, 2] >= 0.0 else -1.0), (len(rows), 1))
    corners, normals = x[hull.simplices], hull.equations[:, :3]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    found = []
    for row in rows:
        own = (hull.simplices == row).any(axis=1)
        nearest = normals[np.argmax(normals @ x[row] + hull.equations[:, 3])]
        normal = areas[own] @ normals[own] if own.any() else nearest
        found.append(normal / np.linalg.norm(normal))
    return np.array(found).reshape(-1, 3)


def facing(camera: SpaceCamera, places_m: Floats, normals: Floats, least: float) -> NDArray[np.bool_]:
    """Whether each mark at these positions [m], (n, 3), faces the camera, (n,).

    normals: (n, 3); least: cosine of the largest angle between a normal and the direction to the camera
    """
    to_camera = camera.centre_m - places_m
    cosines = np.einsum("ni,ni->n", normals, to_camera) / np.linalg.norm(to_camera, axis=1)
    return np.asarray(cosines > least)


def across(normals: Floats) -> Floats:
    """Two perpendicular unit vectors, (n, 3, 2), that span the plane normal to each vector of `normals`, (n, 3)."""
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    one = np.cross(normals, least)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return np.stack([one, np.cross(normals, one) / np.linalg.norm(normals, axis=1, keepdims=True)], axis=2)


def mark_shapes_px(
    marks: Sequence[Mark], camera: SpaceCamera, places_m: Floats, discs: Floats, by_place: Floats
) -> Floats:
    """Shapes of the marks' images [px], (n, 2, 2), see `Outline.shape_px`.

    places_m: positions of the marks [m], (n, 3); discs: `across(normals)` for the normals of the marks, (n, 3, 2)
    by_place: derivatives of the image points with respect to the positions [px/m], (n, 2, 3)
    """
    are_balls = np.array([mark.ball for mark in marks])
    if are_balls.any():  # a ball looks like a disc perpendicular to the line of sight
        discs = np.where(are_balls[:, None, None], across(camera.centre_m - places_m), discs)
    radii_m = np.array([mark.diameter_m / 2.0 for mark in marks])
    return np.asarray(radii_m[:, None, None] * (by_place @ discs), dtype=np.float64)
