"""Lattices of springs along a tissue's structure, their constants, and virtual tests of their moduli.

A new structure, formula or virtual test belongs here.
"""

from dynamics.lattices.constants import DIRECTIONS, Sample, directed, fitted_factors, lloyd, van_gelder
from dynamics.lattices.lattice import Lattice, lattice_network, lattice_of
from dynamics.lattices.moduli import (
    Moduli,
    effective_moduli,
    effective_stiffness,
    free_sided_young,
    orthotropic_moduli,
    spring_stiffness,
    young_along,
)
from dynamics.lattices.structures import STRUCTURES, Structure, fibres, foam, lobules, plain, sheet

__all__ = [
    "DIRECTIONS",
    "STRUCTURES",
    "Lattice",
    "Moduli",
    "Sample",
    "Structure",
    "directed",
    "effective_moduli",
    "effective_stiffness",
    "fibres",
    "fitted_factors",
    "foam",
    "free_sided_young",
    "lattice_network",
    "lattice_of",
    "lloyd",
    "lobules",
    "orthotropic_moduli",
    "plain",
    "sheet",
    "spring_stiffness",
    "van_gelder",
    "young_along",
]
