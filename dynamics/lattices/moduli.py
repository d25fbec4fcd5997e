"""Elastic moduli of a box, by virtual tests.

Components have Voigt's order: xx, yy, zz, yz, xz, xy. Shear strains are twice the tensor's components.

Boundary conditions are mixed, as in [pahr2008]. Under a normal strain, each face moves along its normal and slides
without friction. Under a shear strain, the sheared faces move along their planes, and the other faces slide without
friction. The resulting moduli lie between two limits: prescribed displacements on all faces, and prescribed stresses on
all faces. If the box is the unit cell of a periodic body and symmetric about its three planes, the moduli are exactly
those of this body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from dynamics.arrays import Floats
from dynamics.elements import Assembly, Springs
from dynamics.mesh import factored
from dynamics.network import MassSpringNetwork, NetworkError

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""The two axes of each component of strain, in Voigt's order."""

ON_FACE = 1e-6
"""A node lies on a face if its distance from the face is below this share of the side of the box; numerical."""

LOOSE = 1e-10
"""A node moves without force if a pivot of the factored stiffness is below this share of the largest diagonal entry of
the stiffness; numerical: in lattices of tissues, the least pivot is about 1e-3 of this entry."""

BODY_DIAGONAL = np.ones((1, 3)) / np.sqrt(3.0)


@dataclass(frozen=True, slots=True, eq=False)
class Moduli:
    """Elastic moduli of an orthotropic material along its axes.

    Attributes
    ----------
    stiffness : (6, 6)
        Stiffness matrix in Voigt's order [Pa].
    young : (3,)
        Young's moduli along x, y, z [Pa].
    shear : (3,)
        Shear moduli of yz, xz, xy [Pa].
    poisson : (3,)
        Poisson's ratios for yz, xz, xy: contraction along the second axis per extension along the first under tension.
    bulk : float
        Bulk modulus [Pa]: pressure divided by the relative loss of volume.
    anisotropy : float
        Ratio of the largest to the smallest Young's modulus along axes and diagonals [1].
    """

    stiffness: Floats
    young: Floats
    shear: Floats
    poisson: Floats
    bulk: float
    anisotropy: float


def effective_moduli(network: MassSpringNetwork) -> Moduli:
    """Moduli of a box of springs that rests as drawn. Anchors move like other nodes.

    Raises NetworkError for a network in the plane, and for a loose node, which moves without force.
    """
    return orthotropic_moduli(effective_stiffness(spring_stiffness(network), network.positions))


def spring_stiffness(network: MassSpringNetwork) -> csc_array:
    """Stiffness matrix of the springs in the drawn shape [N/m], (3 n_nodes, 3 n_nodes).

    Raises NetworkError for a network in the plane.
    """
    if network.dim != 3:
        raise NetworkError(f"positions: expected a box in space, found dimension {network.dim}")
    body = Assembly(network.positions, np.arange(network.n_nodes), [Springs.of_network(network)])
    return csc_array(body.tangents(network.positions.ravel(), np.zeros(body.n))[0])


def orthotropic_moduli(stiffness: Floats) -> Moduli:
    """Moduli of a material with a given stiffness matrix [Pa], (6, 6)."""
    S = np.linalg.inv(stiffness)
    young, shear = 1.0 / np.diag(S)[:3], 1.0 / np.diag(S)[3:]
    poisson = np.array([-S[i, j] * young[i] for i, j in PAIRS[3:]])
    along = young_along(stiffness, np.vstack([directions_of(PAIRS), BODY_DIAGONAL]))
    return Moduli(stiffness, young, shear, poisson, float(1.0 / S[:3, :3].sum()), float(along.max() / along.min()))


def directions_of(pairs: tuple[tuple[int, int], ...]) -> Floats:
    """Unit vector for each of n pairs of axes, (n, 3): the axis if both are equal, else the diagonal between them."""
    each = np.array([np.eye(3)[i] + np.eye(3)[j] for i, j in pairs])
    return np.asarray(each / np.linalg.norm(each, axis=1, keepdims=True))


def young_along(stiffness: Floats, directions: Floats) -> Floats:
    """Young's modulus [Pa], (n,), along unit vectors (n, 3), from a stiffness matrix [Pa], (6, 6)."""
    stress = tension(directions)
    return np.asarray(1.0 / np.einsum("da,ab,db->d", stress, np.linalg.inv(stiffness), stress))


def tension(directions: Floats) -> Floats:
    """Stress of a unit tension along each of n unit vectors (n, 3), as components in Voigt's order, (n, 6)."""
    return np.stack([directions[:, i] * directions[:, j] for i, j in PAIRS], axis=1)


def effective_stiffness(K: csc_array, nodes: Floats) -> Floats:
    """Stiffness of a box [Pa], (6, 6), from six virtual tests. Normal and shear strains are assumed to be uncoupled.

    K: stiffness of all nodes [N/m], (3 n, 3 n), node-major; nodes: positions of the nodes [m], (n, 3). Raises
    NetworkError for a loose node, which moves without force.
    """
    return mean_stiffness(K, strained(K, nodes), float(np.ptp(nodes, axis=0).prod()))


def mean_stiffness(K: csc_array, moved: Floats, volume: float) -> Floats:
    """Stiffness [Pa], (6, 6), from the elastic energies in the virtual tests; moved: result of `strained`, (3 n, 6)."""
    C = moved.T @ (K @ moved) / volume
    C[:3, 3:] = C[3:, :3] = 0.0
    C[3:, 3:] = np.diag(np.diag(C)[3:])
    return np.asarray(C)


def strained(K: csc_array, nodes: Floats) -> Floats:
    """Displacements of all nodes, (3 n, 6), in six tests. In each test, one component of the mean strain is 1."""
    on, moved = _on_faces(nodes), np.zeros((len(nodes), 3, 6))
    for q, (i, j) in enumerate(PAIRS):  # Affine: strain times position
        moved[:, i, q] += 0.5 * nodes[:, j]
        moved[:, j, q] += 0.5 * nodes[:, i]
    flat = moved.reshape(-1, 6)
    _relax(K, flat[:, :3], on)
    for q, (i, j) in enumerate(PAIRS[3:], start=3):
        k = 3 - i - j
        given = np.zeros_like(on)
        given[:, i], given[:, j], given[:, k] = on[:, j], on[:, i], on.any(axis=1)
        _relax(K, flat[:, q : q + 1], given)
    return flat


def free_sided_young(K: csc_array, nodes: Floats) -> Floats:
    """Young's moduli of a box along each axis [Pa], (3,), from tension tests with free sides.

    The two pulled faces slide without friction. K, nodes: as in `effective_stiffness`. Raises NetworkError for a loose
    node, which moves without force.
    """
    lowest, size, on = nodes.min(axis=0), np.ptp(nodes, axis=0), _on_faces(nodes)
    found = np.empty(3)
    for a in range(3):
        b, c = np.delete(np.arange(3), a)
        given, moved = np.zeros_like(on), np.zeros(nodes.shape)
        given[:, a], moved[:, a] = on[:, a], nodes[:, a] - lowest[a]
        corner = np.where(np.arange(3) == b, size, 0.0)  # two corners are fixed to prevent rigid motion
        near, far = (int(np.linalg.norm(nodes - lowest - place, axis=1).argmin()) for place in (0.0 * size, corner))
        given[near], given[far, c] = True, True
        flat = moved.reshape(-1, 1)
        _relax(K, flat, given)
        found[a] = (flat.T @ (K @ flat)).item() / size.prod()
    return found


def _on_faces(nodes: Floats) -> NDArray[np.bool_]:
    """Whether each node lies on a face perpendicular to each axis, (n, 3)."""
    lowest, highest = nodes.min(axis=0), nodes.max(axis=0)
    return np.asarray(np.minimum(nodes - lowest, highest - nodes) < ON_FACE * (highest - lowest))


def _relax(K: csc_array, moved: Floats, given: NDArray[np.bool_]) -> None:
    """Replace the entries of `moved`, (3 n, k), by the displacements at equilibrium; `given` entries, (n, 3), are kept.

    Raises NetworkError for a loose node, which moves without force.
    """
    free, held = np.flatnonzero(~given.ravel()), np.flatnonzero(given.ravel())
    rows = csc_array(K[:, free])
    loose = NetworkError("stiffness: expected that of a box without loose nodes, found one that moves without force")
    try:
        factor = factored(rows[free])
    except RuntimeError:  # exactly singular
        raise loose from None
    if np.abs(factor.U.diagonal()).min() < LOOSE * K.diagonal().max():
        raise loose
    moved[free] = factor.solve(-np.asarray(rows[held].T @ moved[held]))
