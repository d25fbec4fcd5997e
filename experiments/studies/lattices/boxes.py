"""One box of tissue as finite elements, and as springs by each method."""

from __future__ import annotations

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
from experiments.engine.runs import Case

SIDE_M = 0.024
"""Side length [m]; moduli do not depend on it."""

MATERIAL = "material"
METHODS = ("van_gelder", "lloyd", "fitted")
"""Methods: two published formulas, and factors fitted to other boxes of the structure."""

AXES, PLANES = ("x", "y", "z"), ("yz", "xz", "xy")

WORDS = {
    "van_gelder": "Van Gelder",
    "lloyd": "Lloyd",
    "fitted": "fitted to other boxes",
}
"""Descriptions of the methods, by name."""

YOUNG = [f"young_{name}_pa" for name in AXES + PLANES]
"""Columns of Young's moduli along axes and diagonals."""

Row = dict[str, Any]


def lattice_by_seed(kind: str, seed: int, cells: int) -> tuple[Lattice, list[Tissue]]:
    """A lattice of a structure, and its tissues."""
    make, names = STRUCTURES[kind]
    rng = np.random.default_rng(seed)
    return lattice_of(make(rng), SIDE_M, cells, rng), [TISSUES[name] for name in names]


def fit(case: Case) -> Row:
    """The row of a structure: `factors`, (6,), fitted to its boxes with the case's seeds."""
    samples = []
    for seed in case["seeds"]:
        lattice, tissues = lattice_by_seed(case["structure"], seed, case["cells"])
        wanted = effective_stiffness(lattice.element_stiffness(tissues), lattice.mesh.nodes)
        stiffness = van_gelder(lattice, lattice.of_elements(tissues, "young_pa"))
        samples.append(Sample(lattice, stiffness, young_along(wanted, DIRECTIONS)))
    return {"factors": fitted_factors(samples).tolist()}


def tested(case: Case) -> list[Row]:
    """Rows of one box, with the `factors` of its structure: one for finite elements, one for springs by each method.

    alignment: mean over the springs in the structure; share: volume share of the structure's tissues
    """
    lattice, tissues = lattice_by_seed(case["structure"], case["seed"], case["cells"])
    elements, inside = lattice.element_stiffness(tissues), lattice.mesh.regions > 0
    young_pa = lattice.of_elements(tissues, "young_pa")
    plain = van_gelder(lattice, young_pa)
    stiffness = {
        "van_gelder": plain,
        "lloyd": lloyd(lattice, young_pa),
        "fitted": directed(lattice, plain, np.array(case["factors"])),
    }
    box = {
        "alignment": float(lattice.alignment[np.unique(lattice.edges[inside])].mean()) if inside.any() else np.nan,
        "share": float(lattice.mesh.volumes[inside].sum() / lattice.mesh.volumes.sum()),
    }
    bodies = {name: spring_stiffness(lattice_network(lattice, stiffness[name], tissues)) for name in METHODS}
    return [box | {"method": name} | _moduli(K, lattice) for name, K in ({MATERIAL: elements} | bodies).items()]


def _moduli(K: csc_array, lattice: Lattice) -> Row:
    found = orthotropic_moduli(effective_stiffness(K, lattice.mesh.nodes))
    along, free = young_along(found.stiffness, DIRECTIONS), free_sided_young(K, lattice.mesh.nodes)
    named = {f"young_{name}_pa": value for name, value in zip(AXES + PLANES, along, strict=True)}
    named |= {f"free_sided_{name}_pa": value for name, value in zip(AXES, free, strict=True)}
    for key, values in (("shear_{}_pa", found.shear), ("poisson_{}", found.poisson)):
        named |= {key.format(name): value for name, value in zip(PLANES, values, strict=True)}
    return {key: float(value) for key, value in named.items()} | {"bulk_pa": found.bulk}
