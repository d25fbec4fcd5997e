"""Meshes of linear tetrahedra, checked at construction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from dynamics.arrays import Floats, made_again

LARGEST_M = 2.0
"""Largest extent of a mesh [m]; choice: no tissue is longer, so the coordinates of a larger mesh are not in metres."""

FLATTEST = 1e-4
"""Least volume of an element, relative to its longest edge cubed [1]; numerical. A regular tetrahedron has 0.12."""


FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
"""Corners of the face opposite each corner of an element, counter-clockwise seen from outside."""


class MeshError(ValueError):
    """Error for a mesh that cannot be used; the message says what was expected and what was found."""


@dataclass(frozen=True, slots=True, eq=False)
class TetMesh:
    """A body of linear tetrahedra in one piece, checked at construction.

    Parameters
    ----------
    nodes : (n, 3)
        Positions at rest [m].
    elements : (m, 4) int
        Nodes of each element. Seen from the fourth node, the first three run counter-clockwise.
    regions : (m,) int
        Tissue of each element, or one tissue for all elements, (1,).

    Attributes
    ----------
    volumes : (m,)
        Volumes of the elements [m³].
    gradients : (m, 4, 3)
        Gradient of the barycentric weight of each corner [1/m].

    Raises
    ------
    MeshError
        If an element is flat or inverted, a node is in no element, a face is in more than two elements, or the body
        exceeds 2 m or has several parts, which share no face.
    """

    nodes: Floats
    elements: NDArray[np.int64]
    regions: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, dtype=np.int64))
    volumes: Floats = field(init=False, repr=False)
    gradients: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        nodes, elements = np.array(self.nodes, dtype=float), np.array(self.elements)
        regions, n, m = np.asarray(self.regions), len(nodes), len(elements)
        if nodes.ndim != 2 or nodes.shape[1] != 3 or not np.isfinite(nodes).all():
            raise MeshError(f"nodes: expected finite numbers of shape (n, 3), found shape {nodes.shape}")
        if elements.shape != (m, 4) or elements.dtype.kind not in "iu" or not m:
            raise MeshError(f"elements: expected integers of shape (m, 4), found {elements.dtype} {elements.shape}")
        if elements.min() < 0 or elements.max() >= n:
            raise MeshError(f"elements: expected nodes 0 to {n - 1}, found {elements.min()} to {elements.max()}")
        if regions.shape not in ((1,), (m,)) or regions.dtype.kind not in "iu":
            raise MeshError(f"regions: expected {m} integers, found {regions.dtype} {regions.shape}")
        edges = nodes[elements[:, 1:]] - nodes[elements[:, :1]]
        volumes = np.linalg.det(edges) / 6.0
        self._check(nodes, elements, edges, volumes)
        inner = np.linalg.inv(edges).swapaxes(1, 2)
        gradients = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
        for key, value in {
            "nodes": nodes,
            "elements": elements.astype(np.int64),
            "regions": np.broadcast_to(regions, m).astype(np.int64),
            "volumes": volumes,
            "gradients": gradients,
        }.items():
            value.setflags(write=False)
            object.__setattr__(self, key, value)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return made_again(self)

    @staticmethod
    def _check(nodes: Floats, elements: NDArray[np.int64], edges: Floats, volumes: Floats) -> None:
        extent = np.ptp(nodes, axis=0).max()
        if extent > LARGEST_M:
            raise MeshError(f"nodes: expected metres, an extent of at most {LARGEST_M:g} m, found {extent:g} m")
        sides = np.concatenate([edges, edges[:, [1, 2, 0]] - edges], axis=1)
        longest = np.sqrt((sides**2).sum(axis=2).max(axis=1))
        for what, wrong in (
            ("flat elements", np.abs(volumes) < FLATTEST * longest**3),
            ("flipped elements, whose volume is negative", volumes < 0.0),
        ):
            if wrong.any():
                first = np.flatnonzero(wrong)[0]
                raise MeshError(
                    f"elements: expected no {what}, found {wrong.sum()} of {len(wrong)}, the first element {first}"
                )
        used = np.bincount(elements.ravel(), minlength=len(nodes)) > 0
        if not used.all():
            raise MeshError(
                f"nodes: expected each in an element, found {(~used).sum()} in none, the first node {used.argmin()}"
            )
        keys = face_keys(elements, len(nodes))
        order = np.argsort(keys)
        shared = keys[order[1:]] == keys[order[:-1]]
        more = np.flatnonzero(shared[1:] & shared[:-1])
        if len(more):
            raise MeshError(
                f"elements: expected each face in at most two, found {len(more)} in more, such as duplicates, "
                f"the first element {order[more].min() // 4}"
            )
        pairs = (order[:-1][shared] // 4, order[1:][shared] // 4)
        graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(len(elements),) * 2)
        parts, part = connected_components(graph, directed=False)
        if parts > 1:
            sizes = np.sort(np.bincount(part))[::-1][:5].tolist()
            raise MeshError(f"elements: expected one body, connected by faces, found {parts} parts of {sizes} elements")


def face_keys(elements: NDArray[np.int64], n_nodes: int) -> NDArray[np.int64]:
    """Numbers of the faces of m elements, (4 m,), equal for faces of the same nodes. Element k has four from 4 k on."""
    faces = np.sort(elements.astype(np.int64)[:, FACES].reshape(-1, 3), axis=1)
    return np.asarray((faces[:, 0] * n_nodes + faces[:, 1]) * n_nodes + faces[:, 2])
