"""Reduced bodies: motion of a body in a few shapes, and the body's forces in these shapes.

A shape is a scalar function of the nodes. A displacement is a sum of shapes, each multiplied by a vector. Each shape
can therefore move the body in any direction. The constant 1 and the rest coordinates are shapes, so affine motions are
exact. All other shapes are computed from the body's responses to forces [benner2015].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from dynamics.arrays import Floats
from dynamics.elements.assembly import Assembly


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """Linear map from a few reduced coordinates to the coordinates of all nodes.

    Attributes
    ----------
    matrix : (n_full, n)
        Map from the reduced coordinates to the coordinates of the nodes.
    onto : (n, n_full)
        Left inverse of `matrix`: the projection that is orthogonal with respect to the masses.
    masses : (n,)
        Masses of the reduced coordinates [kg].
    white : (n,)
        Standard deviation of each reduced acceleration if the nodes' accelerations are independent with variance 1.
    """

    matrix: Floats
    onto: Floats
    masses: Floats
    white: Floats

    def coordinates(self, places: Floats) -> Floats:
        """Reduced coordinates, (n,), that best fit given coordinates of all nodes [m], (n_full,)."""
        return np.asarray(self.onto @ places)

    @property
    def independent(self) -> Floats:
        """Covariance of the reduced coordinates, (n, n), if node coordinates have independent errors of variance 1."""
        return np.asarray(self.onto @ self.onto.T)

    @classmethod
    def whole(cls, masses: Floats) -> Span:
        """The identity map; masses: mass of each coordinate [kg], (n_full,)."""
        n = len(masses)
        return cls(np.eye(n), np.eye(n), masses, np.ones(n))

    @classmethod
    def of_shapes(cls, shapes: Floats, masses: Floats, dim: int) -> Span:
        """Span of r shapes with dim coordinates each; shapes: (n_nodes, r); masses: of the nodes [kg], (n_nodes,).

        A reduced coordinate is a root mean square displacement of the body, weighted by mass [m]. Independent
        accelerations of the nodes give independent reduced accelerations.
        """
        total = masses.sum()
        own = shapes / np.sqrt(np.einsum("ik,i,ik->k", shapes, masses, shapes))
        orthonormal = own @ np.linalg.inv(np.linalg.cholesky(own.T @ (masses[:, None] * own))).T * np.sqrt(total)
        weights, turned = np.linalg.eigh(orthonormal.T @ (masses[:, None] ** 2 * orthonormal) / total**2)
        kept, each = orthonormal @ turned, np.eye(dim)
        return cls(
            np.kron(kept, each),
            np.kron(kept.T * masses / total, each),
            np.full(kept.shape[1] * dim, total),
            np.repeat(np.sqrt(weights), dim),
        )


class ReducedAssembly:
    """Forces and dense tangents of an `Assembly` in reduced coordinates."""

    def __init__(self, whole: Assembly, span: Span) -> None:
        self._whole, self._matrix = whole, span.matrix
        self.n, self.dim = span.matrix.shape[1], whole.dim

    def force(self, q: Floats, v: Floats) -> Floats:
        """Force on the reduced coordinates [N], (n,), at q [m] and v [m/s], (n,)."""
        return np.asarray(self._whole.force(self._matrix @ q, self._matrix @ v) @ self._matrix)

    def linearised(self, q: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        """Force [N], (n,), and dense matrices of stiffness [N/m] and damping [N s/m], (n, n) each."""
        V = self._matrix
        force, K, C = self._whole.linearised(V @ q, V @ v)
        return force @ V, V.T @ (K @ V), V.T @ (C @ V)


def smooth_shapes(
    assembly: Assembly, places: Floats, masses: Floats, forces: Floats, rates: Sequence[float], least_m: float
) -> Floats:
    """Shapes of a body's affine motions, and of its responses to forces, (n_nodes, r).

    Parameters
    ----------
    assembly : Assembly
        The body.
    places : (n_nodes, dim)
        Positions of the free nodes at rest [m].
    masses : (n_nodes,)
        Masses of the nodes [kg].
    forces : (n_nodes dim, n_forces)
        Independent forces as columns; each column is one standard deviation of a force [N].
    rates : sequence of float
        Growth rates s [1/s]. For each rate, the response to forces that grow as `exp(s t)` is computed.
    least_m : float
        Root mean square displacement, weighted by mass, below which a shape is omitted [m].
    """
    q = places.ravel()
    K, C = (csc_array(matrix) for matrix in assembly.tangents(q, np.zeros_like(q)))
    M = diags_array(np.repeat(masses, assembly.dim))
    moved = [splu(csc_array(K + rate * C + rate**2 * M)).solve(forces) for rate in rates]
    n = len(places)
    fields = np.hstack([field.reshape(n, -1) for field in moved])
    root = np.sqrt(masses / masses.sum())[:, None]
    affine = np.linalg.qr(root * np.hstack([np.ones((n, 1)), places - places.mean(axis=0)]))[0]
    fields = root * fields
    fields -= affine @ (affine.T @ fields)
    vectors, sizes, _ = np.linalg.svd(fields, full_matrices=False)
    return np.asarray(np.hstack([affine, vectors[:, sizes > least_m]]) / root)
