"""Moduli of one box of tissue, made of finite elements or of springs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import csc_array

from dynamics.lattices import (
    DIRECTIONS,
    STRUCTURES,
    Lattice,
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
"""Side length [m]; moduli do not depend on it."""

MATERIAL = "material"
METHODS = ("van_gelder", "lloyd", "fitted", "own")
"""Methods for the springs: two published formulas, factors fitted to other boxes of the structure, and factors fitted
to the box itself."""

AXES, PLANES = ("x", "y", "z"), ("yz", "xz", "xy")

Row = dict[str, Any]


def lattice_by_seed(kind: str, seed: int, cells: int) -> tuple[Lattice, list[Tissue]]:
    """A lattice of a structure, and the structure's tissues."""
    make, names = STRUCTURES[kind]
    rng = np.random.default_rng(seed)
    return lattice_of(make(rng), SIDE_M, cells, rng), [TISSUES[name] for name in names]


def fit(job: tuple[str, Sequence[int], int]) -> Floats:
    """Fit the correction factors of a structure, (6,); job: the structure, the boxes' seeds, the number of cells."""
    kind, seeds, cells = job
    samples = []
    for seed in seeds:
        lattice, tissues = lattice_by_seed(kind, seed, cells)
        wanted = effective_stiffness(lattice.element_stiffness(tissues), lattice.mesh.nodes)
        samples.append(_sample(lattice, tissues, young_along(wanted, DIRECTIONS)))
    return fitted_factors(samples)


def tested(job: tuple[str, int, int, Floats]) -> list[Row]:
    """Rows of one box: a row for the material, and a row for the springs of each method.

    job: structure, seed, number of cells, correction factors of the structure
    alignment: mean of `Lattice.alignment` over the structure's springs
    crossing: share of springs that cross a surface of the structure
    share: share of the box's volume that the structure's tissues fill
    """
    kind, seed, cells, factors = job
    lattice, tissues = lattice_by_seed(kind, seed, cells)
    elements, inside = lattice.element_stiffness(tissues), lattice.mesh.regions > 0
    wanted = young_along(effective_stiffness(elements, lattice.mesh.nodes), DIRECTIONS)
    sample = _sample(lattice, tissues, wanted)
    stiffness = {
        "van_gelder": sample.stiffness,
        "lloyd": lloyd(lattice, lattice.of_elements(tissues, "young_pa")),
        "fitted": directed(lattice, sample.stiffness, factors),
        "own": directed(lattice, sample.stiffness, fitted_factors([sample])),
    }
    box = {
        "structure": kind,
        "seed": seed,
        "alignment": float(lattice.alignment[np.unique(lattice.edges[inside])].mean()) if inside.any() else np.nan,
        "crossing": float(lattice.crossing.mean()),
        "share": float(lattice.mesh.volumes[inside].sum() / lattice.mesh.volumes.sum()),
    }
    bodies = {name: spring_stiffness(lattice_network(lattice, stiffness[name], tissues)) for name in METHODS}
    return [box | {"method": name} | _moduli(K, lattice) for name, K in ({MATERIAL: elements} | bodies).items()]


def _sample(lattice: Lattice, tissues: Sequence[Tissue], young: Floats) -> Sample:
    return Sample(lattice, van_gelder(lattice, lattice.of_elements(tissues, "young_pa")), young)


def _moduli(K: csc_array, lattice: Lattice) -> Row:
    found = orthotropic_moduli(effective_stiffness(K, lattice.mesh.nodes))
    along, free = young_along(found.stiffness, DIRECTIONS), free_sided_young(K, lattice.mesh.nodes)
    named = {f"young_{name}_pa": value for name, value in zip(AXES + PLANES, along, strict=True)}
    named |= {f"free_sided_{name}_pa": value for name, value in zip(AXES, free, strict=True)}
    for key, values in (("shear_{}_pa", found.shear), ("poisson_{}", found.poisson)):
        named |= {key.format(name): value for name, value in zip(PLANES, values, strict=True)}
    return {key: float(value) for key, value in named.items()} | {
        "bulk_pa": found.bulk,
        "anisotropy": found.anisotropy,
    }
