"""Validated nodes and springs, and the order of a state vector.

What may enter: parts of tissue, no forces.
"""

from dynamics.network.continuum import Continuum
from dynamics.network.mass_spring import MassSpringNetwork, NetworkError, all_positions, pack, spring_lengths, unpack
from dynamics.network.material import material_coordinates

__all__ = [
    "Continuum",
    "MassSpringNetwork",
    "NetworkError",
    "all_positions",
    "material_coordinates",
    "pack",
    "spring_lengths",
    "unpack",
]
