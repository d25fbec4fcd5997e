"""The network: nodes and springs, checked at construction, and the order of a state vector.

What may enter: what a tissue is made of. It computes no force; `dynamics.forces` does.
"""

from dynamics.network.mass_spring import MassSpringNetwork, NetworkError, all_positions, pack, spring_lengths, unpack
from dynamics.network.material import material_coordinates

__all__ = [
    "MassSpringNetwork",
    "NetworkError",
    "all_positions",
    "material_coordinates",
    "pack",
    "spring_lengths",
    "unpack",
]
