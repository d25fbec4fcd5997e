"""Validated networks of nodes and springs, and conversion of positions and velocities to state vectors.

Parts of tissue belong here, forces do not.
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
