"""One box of tissue as finite elements, and as springs by each method."""

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
"""Methods: two published formulas; factors fitted to other boxes of the structure, or to the box itself."""

AXES, PLANES = ("x", "y", "z"), ("yz", "xz", "xy")

Row = dict[str, Any]


def lattice_by_seed(kind: str, seed: int, cells: int) -> tuple[Lattice, list[Tissue]]:
    """A lattice of a structure, and its tissues."""
    make, names = STRUCTURES[kind]
    rng = np.random.default_rng(seed)
    return lattice_of(make(rng), SIDE_M, cells, rng), [TISSUES[name] for name in names]


def fit(job: tuple[str, Sequence[int], int]) -> Floats:
    """Factors of a structure, (6,), fitted to boxes of these seeds with this number of cells."""
    kind, seeds, cells = job
    samples = []
    for seed in seeds:
        lattice, tissues = lattice_by_seed(kind, seed, cells)
        wanted = effective_stiffness(lattice.element_stiffness(tissues), lattice.mesh.nodes)
        samples.append(_sample(lattice, tissues, young_along(wanted, DIRECTIONS)))
    return fitted_factors(samples)


def tested(job: tuple[str, int, int, Floats]) -> list[Row]:
    """Rows of one box, with these factors of its structure: one for the material, and one for springs by each method.

    alignment: mean over the structure's springs; crossing: share of springs that cross a surface; share: volume share
    of the structure's tissues
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
