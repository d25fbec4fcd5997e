"""Masses and linear stiffness of a mesh at rest, and patches of elements over which the dilatation is averaged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, vstack
from scipy.sparse.linalg import SuperLU, splu

from dynamics.arrays import Floats
from dynamics.mesh.tet_mesh import TetMesh

PATCH = 12
"""Number of elements in a patch; choice: beams in tests bend equally with 8 or more, but a tenth less with 4."""


def lame(young: Floats | float, poisson: Floats | float) -> tuple[Floats, Floats]:
    """Lamé's constants lambda and mu [Pa], from Young's modulus [Pa] and Poisson's ratio [1]."""
    E, nu = np.asarray(young, dtype=float), np.asarray(poisson, dtype=float)
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def lumped_masses(mesh: TetMesh, density: Floats | float) -> Floats:
    """Mass of each node [kg], (n,): a quarter of the mass of its elements; density [kg/m³]: (m,) or one number."""
    share = np.repeat(0.25 * mesh.volumes * density, 4)
    return np.asarray(np.bincount(mesh.elements.ravel(), share, minlength=len(mesh.nodes)), dtype=float)


def patches(mesh: TetMesh, size: int = PATCH) -> NDArray[np.int64]:
    """Index of the patch of each element, (m,). A patch has about `size` neighbouring elements of one region.

    The elements of a region are halved repeatedly, across the longest side of the box around the elements' centres.
    """
    centres, patch = mesh.nodes[mesh.elements].mean(axis=1), np.empty(len(mesh.elements), dtype=np.int64)
    tissues = [np.flatnonzero(mesh.regions == region) for region in np.unique(mesh.regions)]
    parts, n = [(tissue, max(1, round(len(tissue) / size))) for tissue in tissues], 0
    while parts:
        part, count = parts.pop()
        if count == 1:
            patch[part], n = n, n + 1
            continue
        along = centres[part, np.ptp(centres[part], axis=0).argmax()]
        cut = len(part) * (count // 2) // count
        order = part[np.argpartition(along, cut)]
        parts += [(order[:cut], count // 2), (order[cut:], count - count // 2)]
    return patch


class Strains(NamedTuple):
    """Linear map from displacements to small strains. The weighted sum of squared strains is twice the energy [J].

    Attributes
    ----------
    matrix : (k, 3 n_free) csr_array
        Strains per displacement [1/m]. Rows: normal strains of all elements, shears of all elements, mean dilatations
        of all patches. Columns: coordinates, node-major.
    weights : (k,)
        Modulus times volume for each strain [N m].
    elements : (k,) int
        The element of each strain; for the dilatation of a patch, one of the patch's elements.
    """

    matrix: csr_array
    weights: Floats
    elements: NDArray[np.int64]

    @property
    def stiffness(self) -> csc_array:
        """Stiffness matrix at rest [N/m], (3 n_free, 3 n_free)."""
        return csc_array(self.matrix.T @ (self.matrix * self.weights[:, None]))


def strains(
    mesh: TetMesh,
    young: Floats | float,
    poisson: Floats | float,
    free: NDArray[np.int64] | None = None,
    patch: NDArray[np.int64] | None = None,
) -> Strains:
    """Small strains of a mesh; shapes and units of the parameters are those of `rest_stiffness`."""
    m, n = len(mesh.elements), len(mesh.nodes)
    lam, mu = (c * mesh.volumes for c in lame(young, poisson))
    G = mesh.gradients.swapaxes(1, 2)
    columns = 3 * mesh.elements[:, None, :] + np.arange(3)[:, None]
    normal = _rows(G, columns, n)
    b, c = [1, 2, 0], [2, 0, 1]  # axes of the shears
    shear = _rows(np.concatenate([G[:, b], G[:, c]], 2), np.concatenate([columns[:, c], columns[:, b]], 2), n)
    of = np.arange(m) if patch is None else patch
    some = np.zeros(of.max() + 1, dtype=np.int64)
    some[of] = np.arange(m)
    share = (mesh.volumes / np.bincount(of, mesh.volumes)[of])[:, None, None] * G
    dilatation = csr_array((share.ravel(), (np.repeat(of, 12), columns.ravel())), shape=(len(some), 3 * n))
    whole = csr_array(vstack([normal, shear, dilatation]))
    kept = slice(None) if free is None else (3 * np.asarray(free)[:, None] + np.arange(3)).ravel()
    each = np.repeat(np.arange(m), 3)
    weights = np.concatenate([2.0 * mu[each], mu[each], np.bincount(of, lam)])
    return Strains(csr_array(whole[:, kept]), weights, np.concatenate([each, each, some]))


def _rows(entries: Floats, columns: NDArray[np.int64], n_nodes: int) -> csr_array:
    """Sparse matrix, (3 m, 3 n_nodes), with three rows per element; entries, columns: (m, 3, any)."""
    m, _, many = entries.shape
    return csr_array((entries.ravel(), columns.ravel(), many * np.arange(3 * m + 1)), shape=(3 * m, 3 * n_nodes))


def rest_stiffness(
    mesh: TetMesh,
    young: Floats | float,
    poisson: Floats | float,
    free: NDArray[np.int64] | None = None,
    patch: NDArray[np.int64] | None = None,
) -> csc_array:
    """Stiffness matrix of a mesh at rest for small strains [N/m], (3 n_free, 3 n_free), node-major.

    Parameters
    ----------
    mesh : TetMesh
        Mesh of m elements.
    young, poisson : (m,) or float
        Young's modulus [Pa] and Poisson's ratio [1] of each element.
    free : (n_free,) int, optional
        Nodes that move; default: all nodes.
    patch : (m,) int, optional
        Patch of each element, over which the dilatation is averaged; default: each element alone.
    """
    return strains(mesh, young, poisson, free, patch).stiffness


def factored(K: csc_array) -> SuperLU:
    """Factors of a symmetric positive definite matrix, (n, n); RuntimeError if the matrix is exactly singular."""
    options = {"SymmetricMode": True}
    return splu(csc_array(K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
