"""Linear tetrahedra of a mesh. In nearly incompressible tissue, a patch of tetrahedra has one mean dilatation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynamics.arrays import Floats
from dynamics.elements.kernels import (
    COROTATED,
    LINEAR,
    NEO_HOOKEAN,
    PackedTetrahedra,
    tetrahedra_forces,
    tetrahedra_tangents,
)
from dynamics.mesh import TetMesh, lame

Numbers = float | Floats

LAWS = {"linear": LINEAR, "corotated": COROTATED, "neo-hookean": NEO_HOOKEAN}
"""Material laws for small strains, for small strains with large rotations, and for large strains."""


class TissueConstants(NamedTuple):
    """Young's modulus [Pa], Poisson's ratio [1], damping time [s]: arrays (m,) for m tetrahedra, or a number for all.

    At rest the damping matrix is the stiffness matrix multiplied by the damping time.
    """

    modulus: Numbers
    poisson: Numbers
    damping: Numbers = 0.0


class Tetrahedra:
    """Tetrahedra of a mesh as force elements. An element is a patch or, without patches, one tetrahedron.

    Parameters
    ----------
    mesh : TetMesh
    law : str
        A key of `LAWS`.
    constants : TissueConstants
    patch : (m,) int, optional
        Patch of each tetrahedron, see `dynamics.mesh.patches`; needed for Poisson's ratios above about 0.45.

    Attributes
    ----------
    nodes : (n_patches, n_corners) int
        Nodes of each patch. A patch with fewer nodes than others repeats its first node.

    Notes
    -----
    An inverted neo-Hookean tetrahedron has infinite energy, and its force is NaN.
    """

    def __init__(
        self, mesh: TetMesh, law: str, constants: TissueConstants, patch: NDArray[np.int64] | None = None
    ) -> None:
        m, n = len(mesh.elements), len(mesh.nodes)
        if law not in LAWS:
            raise ValueError(f"law: expected one of {', '.join(LAWS)}, found {law}")
        modulus, poisson, damping = (np.broadcast_to(np.asarray(c, dtype=float), m) for c in constants)
        self.law, self.constants = LAWS[law], TissueConstants(modulus, poisson, damping)
        if not ((modulus > 0.0) & (poisson > -1.0) & (poisson < 0.5) & (damping >= 0.0)).all():
            raise ValueError(
                "constants: expected moduli above 0, Poisson's ratios from -1 to below 0.5, damping of 0 or more,"
                f" found at least {modulus.min():g}, {poisson.min():g}, {damping.min():g}, at most {poisson.max():g}"
            )
        patch = np.arange(m) if patch is None else np.unique(patch, return_inverse=True)[1]
        if patch.shape != (m,):
            raise ValueError(f"patch: expected a number for each of {m} tetrahedra, found {len(patch)}")
        self._order = np.argsort(patch, kind="stable")
        elements, patch = mesh.elements[self._order], patch[self._order]
        members, place = np.unique(n * patch[:, None] + elements, return_inverse=True)
        firsts = np.searchsorted(members, n * np.arange(patch[-1] + 2))
        of = members // n
        self.nodes = np.repeat((members % n)[firsts[:-1], None], np.diff(firsts).max(), axis=1)
        self.nodes[of, np.arange(len(of)) - firsts[of]] = members % n
        self._packed = PackedTetrahedra(
            np.searchsorted(patch, np.arange(patch[-1] + 2)),
            place.reshape(m, 4) - firsts[patch][:, None],
            mesh.volumes[self._order],
            mesh.gradients[self._order],
        )
        self._moduli = self._of(*lame(modulus, poisson), 1.0, damping)

    def energy(self, x: Floats) -> Floats:
        """Stored energy of each patch [J], (n_patches,)."""
        return self._forces(x, np.zeros_like(x), self._moduli)[0]

    def force(self, x: Floats, v: Floats) -> Floats:
        """Force on the corners [N], (n_patches, n_corners, 3)."""
        return self._forces(x, v, self._moduli)[1]

    def tangents(self, x: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Stiffness [N/m] and damping [N s/m], (n_patches, n_corners, 3, n_corners, 3) each."""
        K, C = (np.zeros(x.shape + x.shape[1:]) for _ in range(2))
        tetrahedra_tangents(x, v, self.law, self._packed, self._moduli, K, C)
        return K, C

    def by_log_constants(self, x: Floats, v: Floats) -> Mapping[str, Floats]:
        """Derivatives of the force by the logs of Young's modulus, Poisson's ratio and damping [N], shaped as `force`.

        The constants of a patch change together. The derivative for a region is the sum over its patches.
        """
        E, nu, damping = (np.asarray(c) for c in self.constants)
        by_nu = E * nu * (1.0 + 2.0 * nu**2) / ((1.0 + nu) * (1.0 - 2.0 * nu)) ** 2, -0.5 * E * nu / (1.0 + nu) ** 2
        moduli = {
            "modulus": self._moduli,
            "poisson": self._of(*by_nu, 1.0, damping),
            "damping": self._of(*lame(E, nu), 0.0, damping),
        }
        return {kind: self._forces(x, v, own)[1] for kind, own in moduli.items()}

    def _of(self, lam: Floats, mu: Floats, stored: float, damping: Floats) -> Floats:
        """Moduli for the kernels, (m, 4): lam and mu times `stored`, then lam and mu times `damping`."""
        return np.stack([stored * lam, stored * mu, damping * lam, damping * mu], axis=1)[self._order]

    def _forces(self, x: Floats, v: Floats, moduli: Floats) -> tuple[Floats, Floats]:
        energy, force = np.empty(len(x)), np.zeros(x.shape)
        tetrahedra_forces(x, v, self.law, self._packed, moduli, energy, force)
        return energy, force
