"""Force elements with energy, force and derivatives; sparse assembly of the elements.

A new kind of `ForceElement` belongs here.
"""

from dynamics.elements.assembly import Assembly
from dynamics.elements.continuum import LEFT_OUT, NEAR, continuum_network, dilatation_patches, matern, points_of
from dynamics.elements.element import ForceElement
from dynamics.elements.nodal import Resistance, Weight
from dynamics.elements.reduced import ReducedAssembly, Span, smooth_shapes
from dynamics.elements.springs import Springs
from dynamics.elements.tetrahedra import Tetrahedra, TissueConstants

__all__ = [
    "LEFT_OUT",
    "NEAR",
    "Assembly",
    "ForceElement",
    "ReducedAssembly",
    "Resistance",
    "Span",
    "Springs",
    "Tetrahedra",
    "TissueConstants",
    "Weight",
    "continuum_network",
    "dilatation_patches",
    "matern",
    "points_of",
    "smooth_shapes",
]
