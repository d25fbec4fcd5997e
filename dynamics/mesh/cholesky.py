"""Cholesky factorisation of a mesh matrix by nested dissection [george1973] and dense fronts [duff1983].

The set of cells is halved repeatedly, which gives a tree of parts. The elimination proceeds from the smallest parts to
the whole mesh. In each part, the nodes that belong only to cells of this part are eliminated. The part's other nodes
remain. Their Schur complement is added to the matrix of the next larger part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.blas import dsyrk
from scipy.sparse import csc_array, csr_array

from dynamics.arrays import Floats

LEAF = 1500
"""A part of the mesh is halved if the numbers of nodes of its cells sum to more than this; numerical: with half or
twice this number, the factorisation of a breast of 14,000 nodes takes up to a third longer."""

Ints = NDArray[np.int64]


class _Front(NamedTuple):
    """Factors of a part: `chol` of the rows `own`, (m, m), and their `coupling` to the rows `others`, (m, k)."""

    own: Ints
    others: Ints
    chol: Floats
    coupling: Floats


class MeshCholesky:
    """Cholesky factors of a symmetric positive definite matrix of a mesh.

    Parameters
    ----------
    K : (n dim, n dim) csc_array
        Matrix, node-major, for n nodes.
    places : (n, 3)
        Positions of the nodes [m].
    cells : (m, n) csr_array
        Row i is nonzero at the nodes of cell i. K couples only nodes of the same cell.

    Raises
    ------
    numpy.linalg.LinAlgError
        K is not positive definite.
    """

    def __init__(self, K: csc_array, places: Floats, cells: csr_array) -> None:
        kept = cells[np.flatnonzero(np.diff(cells.indptr))]
        elimination = _Elimination(
            K,
            kept,
            np.minimum.reduceat(places[kept.indices], kept.indptr[:-1]),
            np.bincount(kept.indices),
            np.full(K.shape[0], -1),
            [],
        )
        elimination.part(np.arange(kept.shape[0]))
        self._fronts = elimination.fronts

    def solve(self, forces: Floats) -> Floats:
        """Solutions x of `K x = forces`; forces, x: (n dim, k)."""
        x = np.array(forces, dtype=float, order="C")
        for own, others, chol, coupling in self._fronts:
            x[own] = solve_triangular(chol, x[own], lower=True, check_finite=False)
            x[others] -= coupling.T @ x[own]
        for own, others, chol, coupling in reversed(self._fronts):
            x[own] = solve_triangular(chol, x[own] - coupling @ x[others], lower=True, trans=1, check_finite=False)
        return x


class _Contribution(NamedTuple):
    """Contribution of a part of the mesh to the next larger part.

    nodes: the nodes that are not yet eliminated, (k,); counts: number of the part's cells at each of these nodes, (k,)
    schur: lower half of the Schur complement of these nodes, (k dim, k dim)
    """

    nodes: Ints
    counts: Ints
    schur: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Elimination:
    """Elimination of the rows of K, part by part (nested dissection).

    lowest: smallest x, smallest y, smallest z in each cell [m], (m, 3); shared: number of cells at each node, (n,)
    local: index of each row of K in the present front, (n dim,); -1 for eliminated rows
    """

    K: csc_array
    cells: csr_array
    lowest: Floats
    shared: Ints
    local: Ints
    fronts: list[_Front]

    def part(self, cells: Ints) -> _Contribution:
        """Eliminate the inner nodes of a set of cells, append the factors, and return the Schur complement."""
        half = len(cells) // 2
        if half and np.diff(self.cells.indptr)[cells].sum() > LEAF:
            along = self.lowest[cells, np.ptp(self.lowest[cells], axis=0).argmax()]
            order = cells[np.argpartition(along, half)]
            below = [self.part(order[:half]), self.part(order[half:])]
            nodes, place = np.unique(np.concatenate([each.nodes for each in below]), return_inverse=True)
            counts = np.bincount(place, np.concatenate([each.counts for each in below])).astype(np.int64)
        else:
            below = []
            nodes, counts = np.unique(self.cells[cells].indices, return_counts=True)
        inner = counts == self.shared[nodes]
        left = nodes[~inner]
        schur = self._front(self._rows(nodes[inner]), self._rows(left), below)
        return _Contribution(left, counts[~inner], schur)

    def _rows(self, nodes: Ints) -> Ints:
        dim = self.K.shape[0] // len(self.shared)
        return (dim * nodes[:, None] + np.arange(dim)).ravel()

    def _front(self, own: Ints, others: Ints, below: list[_Contribution]) -> Floats:
        m, size = len(own), len(own) + len(others)
        self.local[own], self.local[others] = np.arange(m), np.arange(m, size)
        front = np.zeros((size, size), order="F")
        entries = self.K[:, own].tocoo()
        rows = self.local[entries.row]
        front[rows[rows >= 0], entries.col[rows >= 0]] = entries.data[rows >= 0]
        for each in below:
            _add(front, each.schur, self.local[self._rows(each.nodes)])
        self.local[own] = -1
        chol = cholesky(front[:m, :m], lower=True, check_finite=False)
        coupling = solve_triangular(chol, front[m:, :m].T, lower=True, check_finite=False)
        self.fronts.append(_Front(own, others, chol, coupling))
        rest = front[m:, m:]
        return np.asarray(dsyrk(-1.0, coupling, 1.0, rest, trans=1, lower=1)) if coupling.size else rest.copy()


@njit(cache=True, nogil=True)
def _add(front, schur, at):  # type: ignore[no-untyped-def]
    """Add the lower half of a symmetric matrix to the lower half of a front, at the rows `at`."""
    for j in range(len(at)):
        for i in range(j, len(at)):
            front[max(at[i], at[j]), min(at[i], at[j])] += schur[i, j]
