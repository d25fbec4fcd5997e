"""Spring constants of a lattice from Young's modulus, by published formulas or by a fit to virtual tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array

from dynamics.arrays import Floats
from dynamics.lattices.lattice import Lattice
from dynamics.lattices.moduli import PAIRS, directions_of, mean_stiffness, strained, tension, young_along

DIRECTIONS = directions_of(PAIRS)
"""Unit vectors along which Young's moduli are fitted, (6, 3): x, y, z and the diagonals of yz, xz, xy."""

STEPS, LARGEST, CONVERGED = 20, 2.0, 1e-4
"""STEPS is the largest number of steps of the fit, and LARGEST the largest change of a factor in a step. The fit ends
if all changes are below CONVERGED. All three are numerical."""


def van_gelder(lattice: Lattice, young: Floats) -> Floats:
    """Spring stiffness [N/m], (n_springs,), by van Gelder's formula; young: Young's modulus of each tetrahedron [Pa].

    Each tetrahedron of volume V adds `E V / l²` to each of its edges, with the length l of the edge [vangelder1998].
    """
    return lattice.of_springs(young * lattice.mesh.volumes) / lattice.lengths**2


def lloyd(lattice: Lattice, young: Floats) -> Floats:
    """Spring stiffness [N/m], (n_springs,), by Lloyd's formula; young: Young's modulus of each tetrahedron [Pa], (m,).

    Each tetrahedron adds `2 sqrt(2) / 25 E l` to its edges, with l the edge of a regular one of equal volume
    [lloyd2007].
    """
    edge = (6.0 * np.sqrt(2.0) * lattice.mesh.volumes) ** (1.0 / 3.0)
    return lattice.of_springs(2.0 * np.sqrt(2.0) / 25.0 * young * edge)


def directed(lattice: Lattice, stiffness: Floats, factors: Floats) -> Floats:
    """Stiffness [N/m], (n_springs,), multiplied by a factor that depends on the spring's direction.

    factors: coefficients of the log of this factor [1], (6,). For a spring along the unit vector n, the log is the sum
        over q of `factors[q] (n[i] n[j])²`, with `i, j = PAIRS[q]`.
    """
    return np.asarray(stiffness * np.exp(_quartics(lattice) @ factors))


class Sample(NamedTuple):
    """A lattice and its wanted moduli, for `fitted_factors`.

    stiffness: stiffness of the springs before the fit [N/m], (n_springs,)
    young: wanted Young's moduli along `DIRECTIONS` [Pa], (6,)
    """

    lattice: Lattice
    stiffness: Floats
    young: Floats


def fitted_factors(samples: Sequence[Sample]) -> Floats:
    """Factors for `directed` [1], (6,), for which lattices of one structure have the wanted Young's moduli.

    For one lattice, the fit is exact. For several lattices, it minimises the squared errors of the logs of the moduli.
    Raises ValueError if no factors are found.
    """
    factors, boxes = np.zeros(len(DIRECTIONS)), [_elongations(sample.lattice) for sample in samples]
    for _ in range(STEPS):
        parts = [_linearised(sample, box, factors) for sample, box in zip(samples, boxes, strict=True)]
        missing, slopes = (np.concatenate(part) for part in zip(*parts, strict=True))
        step = np.linalg.lstsq(slopes, missing, rcond=None)[0]
        factors = factors + np.clip(step, -LARGEST, LARGEST)
        if np.abs(step).max() < CONVERGED:
            return factors
    raise ValueError(f"expected factors that meet the moduli, found none in {STEPS} steps")


def _quartics(lattice: Lattice) -> Floats:
    return tension(lattice.directions) ** 2


def _elongations(lattice: Lattice) -> csr_array:
    """Derivative of the elongations of springs with respect to the displacements of nodes, (n_springs, 3 n)."""
    n, columns = len(lattice.springs), 3 * lattice.springs[:, :, None] + np.arange(3)
    entries = np.stack([-lattice.directions, lattice.directions], axis=1).ravel()
    where = (np.repeat(np.arange(n), 6), columns.ravel())
    return csr_array((entries, where), shape=(n, 3 * len(lattice.mesh.nodes)))


def _linearised(sample: Sample, box: csr_array, factors: Floats) -> tuple[Floats, Floats]:
    """Wanted minus present log of each modulus, (6,), and derivatives of the present logs by the factors, (6, 6).

    Under unit tension, `d(1/E) = -sum(e² dk) / V`. V is the volume of the lattice, e the elongation and k the stiffness
    of each spring.
    """
    nodes, k = sample.lattice.mesh.nodes, directed(sample.lattice, sample.stiffness, factors)
    volume, K = float(np.ptp(nodes, axis=0).prod()), csc_array(box.T @ diags_array(k) @ box)
    moved = strained(K, nodes)
    C = mean_stiffness(K, moved, volume)
    young, strain = young_along(C, DIRECTIONS), np.linalg.solve(C, tension(DIRECTIONS).T)
    elongation = np.asarray(box @ moved)
    squared = (elongation[:, :3] @ strain[:3]) ** 2 + elongation[:, 3:] ** 2 @ strain[3:] ** 2
    slopes = young[:, None] * (k[:, None] * squared).T / volume
    return np.log(sample.young / young), slopes @ _quartics(sample.lattice)
