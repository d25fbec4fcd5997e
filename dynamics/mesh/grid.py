"""Tetrahedra of a regular grid: six per cell."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray


def grid_tetrahedra(counts: Sequence[int]) -> NDArray[np.int64]:
    """Corners of a grid's tetrahedra, (m, 4); grid nodes are numbered along z first. counts: cells per axis, (3,)."""
    index = np.arange(np.prod(np.add(counts, 1))).reshape(np.add(counts, 1))
    cells = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    elements = []
    for order in permutations(range(3)):
        turn = np.eye(3, dtype=np.int64)[list(order)]
        corners = np.cumsum(np.vstack([np.zeros(3, dtype=np.int64), turn]), axis=0)
        own = index[tuple(np.moveaxis(cells + corners[:, None], -1, 0))].T
        elements.append(own if np.linalg.det(turn) > 0.0 else own[:, [0, 2, 1, 3]])
    return np.concatenate(elements)
