"""Meshes of tetrahedra: surface, points, patches, stiffness at rest and its factorisation.

Geometry at rest belongs here.
"""

from dynamics.mesh.cholesky import MeshCholesky
from dynamics.mesh.grid import grid_tetrahedra
from dynamics.mesh.points import INSIDE, far_apart, locate, locate_on_surface, nearest_elements
from dynamics.mesh.stiffness import Strains, factored, lame, lumped_masses, patches, rest_stiffness, strains
from dynamics.mesh.surface import Surface, surface
from dynamics.mesh.tet_mesh import MeshError, TetMesh
from dynamics.mesh.tissue import Tissue

__all__ = [
    "INSIDE",
    "MeshCholesky",
    "MeshError",
    "Strains",
    "Surface",
    "TetMesh",
    "Tissue",
    "factored",
    "far_apart",
    "grid_tetrahedra",
    "lame",
    "locate",
    "locate_on_surface",
    "lumped_masses",
    "nearest_elements",
    "patches",
    "rest_stiffness",
    "strains",
    "surface",
]
