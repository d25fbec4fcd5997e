"""Blocks of tetrahedra for tests: six to a cell, inner nodes moved aside at random."""

import numpy as np

from dynamics.mesh import TetMesh, grid_tetrahedra


def block(counts, size, jitter=0.15, **fields) -> TetMesh:
    """Cells (3,) along the axes of a block of some size [m], (3,); jitter: of inner nodes, by the least cell edge."""
    axes = [np.linspace(0.0, s, c + 1) for s, c in zip(size, counts, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inner = ((nodes > 1e-9) & (nodes < np.array(size) - 1e-9)).all(axis=1)
    step = jitter * min(s / c for s, c in zip(size, counts, strict=True))
    nodes[inner] += step * np.random.default_rng(1).uniform(-1.0, 1.0, (inner.sum(), 3))
    return TetMesh(nodes, grid_tetrahedra(counts), **fields)
