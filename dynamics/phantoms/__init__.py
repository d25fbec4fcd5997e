"""Built-in phantoms, and elastic bodies from given nodes.

A new network belongs here.
"""

from dynamics.phantoms.breast import breast_phantom
from dynamics.phantoms.breast_mesh import TISSUES, breast_mesh, breast_points
from dynamics.phantoms.four_mass import HIDDEN, OUTER, four_mass_phantom
from dynamics.phantoms.lattice import Phantom, elastic_body, elastic_stiffness, on_hull, to_outside
from dynamics.phantoms.planar import planar_phantom

__all__ = [
    "HIDDEN",
    "OUTER",
    "TISSUES",
    "Phantom",
    "breast_mesh",
    "breast_phantom",
    "breast_points",
    "elastic_body",
    "elastic_stiffness",
    "four_mass_phantom",
    "on_hull",
    "planar_phantom",
    "to_outside",
]
