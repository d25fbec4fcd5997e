"""Breast phantom as a mesh: a half ellipsoid of fat on a chest wall, with glandular tissue in its middle.

x points right, y up, z away from the chest wall, which is at z = 0. The constants below define this phantom; they are
not settings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynamics.arrays import Floats
from dynamics.mesh import TetMesh, Tissue, far_apart, grid_tetrahedra, surface

SEMI_AXES_M = (0.065, 0.065, 0.055)
"""Half width, half height and depth [m]."""

ROUND = 0.8
"""Rounding of the grid: 0 gives a box, 1 an ellipsoid. With 1, elements at the edges of the box would be flat."""

CORE = 0.6
"""Extent of the gland, relative to the breast's extent [1]."""

TISSUES = (Tissue("fat", 3e3, 0.45, 950.0, 0.05), Tissue("gland", 9e3, 0.45, 1050.0, 0.05))
"""Tissues in the order of the regions. Moduli have the order of magnitude of measured moduli [samani2007]."""

TARGET = (0.2, 0.15, 0.45)
"""Position of the target, relative to the semi-axes."""


def breast_mesh(across: int = 12, deep: int = 8) -> tuple[TetMesh, NDArray[np.int64]]:
    """A mesh, and its nodes on the chest wall, (n_fixed,); across, deep: numbers of cells in width and in depth.

    The mesh has (across + 1)² (deep + 1) nodes, and six tetrahedra per cell.
    """
    counts = (across, across, deep)
    axes = [np.linspace(-1.0, 1.0, across + 1)] * 2 + [np.linspace(0.0, 1.0, deep + 1)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    far, length = np.abs(grid).max(axis=1), np.maximum(np.linalg.norm(grid, axis=1), 1e-12)
    nodes = grid * (1.0 - ROUND + ROUND * far / length)[:, None]
    tetrahedra = grid_tetrahedra(counts)
    is_gland = np.linalg.norm(nodes[tetrahedra].mean(axis=1), axis=1) < CORE
    return TetMesh(nodes * SEMI_AXES_M, tetrahedra, is_gland.astype(int)), np.flatnonzero(grid[:, 2] == 0.0)


def breast_points(mesh: TetMesh, fixed: NDArray[np.int64], n_marks: int = 40) -> dict[str, Floats]:
    """Positions [m] of a `target` inside, and of marks `M1`, `M2` and so on, far from each other on the skin."""
    on_skin = mesh.nodes[np.setdiff1d(surface(mesh).nodes, fixed)]
    chosen = far_apart(on_skin, n_marks, [int(on_skin[:, 2].argmax())])
    marks = {f"M{k}": on_skin[i] for k, i in enumerate(chosen, start=1)}
    return marks | {"target": np.array(TARGET) * SEMI_AXES_M}
