"""Masses and linear stiffness of a mesh at rest, and patches of elements whose dilatation is averaged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csc_array, csr_array
from scipy.sparse.linalg import SuperLU, splu

from dynamics.arrays import Floats
from dynamics.mesh.tet_mesh import TetMesh

PATCH = 12
"""Elements of a patch [1]; choice: the beams of the tests bend alike from 8 on, and at 4 by a tenth less."""


def lame(young: Floats | float, poisson: Floats | float) -> tuple[Floats, Floats]:
    """Lamé's constants lambda and mu [Pa] by Young's modulus [Pa] and Poisson's ratio."""
    E, nu = np.asarray(young, dtype=float), np.asarray(poisson, dtype=float)
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def lumped_masses(mesh: TetMesh, density: Floats | float) -> Floats:
    """Mass of each node [kg], (n,): a quarter of each of its elements; density [kg/m³], (m,) or one number."""
    share = np.repeat(0.25 * mesh.volumes * density, 4)
    return np.asarray(np.bincount(mesh.elements.ravel(), share, minlength=len(mesh.nodes)), dtype=float)


def patches(mesh: TetMesh, size: int = PATCH) -> NDArray[np.int64]:
    """The patch of each element, (m,) int: about `size` neighbours within one region, if the region has as many.

    Halved again and again across the widest direction of the elements' centres.
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


def rest_stiffness(
    mesh: TetMesh,
    young: Floats | float,
    poisson: Floats | float,
    free: NDArray[np.int64] | None = None,
    patch: NDArray[np.int64] | None = None,
) -> csc_array:
    """Stiffness at rest [N/m], (3 n_free, 3 n_free), node-major, of small strains.

    Parameters
    ----------
    mesh : TetMesh
        Of m elements.
    young, poisson : (m,) or float
        Young's modulus [Pa] and Poisson's ratio of each element.
    free : (n_free,) int, optional
        Nodes that move; all where it is not given.
    patch : (m,) int, optional
        Of each element, over which the dilatation is averaged; each its own where it is not given.
    """
    elements, m, n = mesh.elements, len(mesh.elements), len(mesh.nodes)
    lam, mu = (c * mesh.volumes for c in lame(young, poisson))
    # Shear, by pairs of corners: mu (G_bi G_aj + G_a . G_b delta_ij), each pair of nodes added up
    G = mesh.gradients
    blocks = np.einsum("e,ebi,eaj->eabij", mu, G, G)
    blocks += np.einsum("e,eai,ebi->eab", mu, G, G)[..., None, None] * np.eye(3)
    pairs, which = np.unique((n * elements[:, :, None] + elements[:, None, :]).ravel(), return_inverse=True)
    summed = np.stack([np.bincount(which, entry) for entry in blocks.reshape(-1, 9).T], axis=1).reshape(-1, 3, 3)
    starts = np.searchsorted(pairs, n * np.arange(n + 1))
    shear = bsr_array((summed, pairs % n, starts), shape=(3 * n, 3 * n))
    # Bulk: lambda by the mean dilatation of each patch
    of = np.arange(m) if patch is None else patch
    share = (mesh.volumes / np.bincount(of, mesh.volumes)[of])[:, None, None] * G
    columns = 3 * elements[:, :, None] + np.arange(3)
    dilatation = csr_array((share.ravel(), (np.repeat(of, 12), columns.ravel())), shape=(of.max() + 1, 3 * n))
    K = (shear + dilatation.T @ (dilatation * np.bincount(of, lam)[:, None])).tocsc()
    rows = slice(None) if free is None else (3 * np.asarray(free)[:, None] + np.arange(3)).ravel()
    return csc_array(K[:, rows][rows])


def factored(K: csc_array) -> SuperLU:
    """The factors of a symmetric positive definite matrix, (n, n); RuntimeError if it is exactly singular."""
    options = {"SymmetricMode": True}
    return splu(csc_array(K), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
