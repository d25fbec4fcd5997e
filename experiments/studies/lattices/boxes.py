"""One box of tissue as elements, and as springs by each method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array

from dynamics.lattices import (
    DIRECTIONS,
    STRUCTURES,
    Lattice,
    Moduli,
    Sample,
    directed,
    effective_stiffness,
    fitted_factors,
    free_sided_young,
    lattice_network,
    lattice_of,
    lloyd,
    orthotropic_moduli,
    spring_stiffness,
    van_gelder,
    young_along,
)
from dynamics.mesh import Tissue
from dynamics.mesh.tissues import TISSUES
from experiments.arrays import Floats

SIDE_M = 0.024
"""Side length; moduli do not depend on it."""

MATERIAL = "material"
METHODS = ("van_gelder", "lloyd", "fitted", "own")
"""Formulas; factors fitted to other boxes of the structure; factors fitted to the box itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Moduli of a box.

    along: Young's moduli along `DIRECTIONS` [Pa], (6,); free: along the axes with free sides [Pa], (3,)
    """

    moduli: Moduli
    along: Floats
    free: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """What is found of one box, by `MATERIAL` and `METHODS`.

    alignment: mean over springs of the structure, None without one; crossing: share of springs that cross a surface
    shares: of the tissues, of the volume
    """

    kind: str
    seed: int
    alignment: float | None
    crossing: float
    shares: tuple[float, ...]
    found: dict[str, Found]


def lattice_by_seed(kind: str, seed: int, cells: int) -> tuple[Lattice, list[Tissue]]:
    """A lattice of a structure, and its tissues."""
    make, names = STRUCTURES[kind]
    rng = np.random.default_rng(seed)
    return lattice_of(make(rng), SIDE_M, cells, rng), [TISSUES[name] for name in names]


def fit(job: tuple[str, Sequence[int], int]) -> Floats:
    """Factors of a structure, (6,), by boxes of these seeds and of so many cells."""
    kind, seeds, cells = job
    samples = []
    for seed in seeds:
        lattice, tissues = lattice_by_seed(kind, seed, cells)
        wanted = effective_stiffness(lattice.element_stiffness(tissues), lattice.mesh.nodes)
        samples.append(_sample(lattice, tissues, young_along(wanted, DIRECTIONS)))
    return fitted_factors(samples)


def tested(job: tuple[str, int, int, Floats]) -> Box:
    """One box with these factors of its structure."""
    kind, seed, cells, factors = job
    lattice, tissues = lattice_by_seed(kind, seed, cells)
    material = _found(lattice.element_stiffness(tissues), lattice)
    sample = _sample(lattice, tissues, material.along)
    stiffness = {
        "van_gelder": sample.stiffness,
        "lloyd": lloyd(lattice, lattice.of_elements(tissues, "young_pa")),
        "fitted": directed(lattice, sample.stiffness, factors),
        "own": directed(lattice, sample.stiffness, fitted_factors([sample])),
    }
    found = {MATERIAL: material}
    for name in METHODS:
        found[name] = _found(spring_stiffness(lattice_network(lattice, stiffness[name], tissues)), lattice)
    inside = lattice.edges[lattice.mesh.regions > 0].ravel()
    alignment = float(lattice.alignment[np.unique(inside)].mean()) if len(inside) else None
    shares = (
        np.bincount(lattice.mesh.regions, lattice.mesh.volumes, minlength=len(tissues)) / lattice.mesh.volumes.sum()
    )
    return Box(kind, seed, alignment, float(lattice.crossing.mean()), tuple(shares.tolist()), found)


def _sample(lattice: Lattice, tissues: Sequence[Tissue], young: Floats) -> Sample:
    return Sample(lattice, van_gelder(lattice, lattice.of_elements(tissues, "young_pa")), young)


def _found(K: csc_array, lattice: Lattice) -> Found:
    stiffness = effective_stiffness(K, lattice.mesh.nodes)
    along = young_along(stiffness, DIRECTIONS)
    return Found(orthotropic_moduli(stiffness), along, free_sided_young(K, lattice.mesh.nodes))
