"""Statics: rest shapes, rest lengths from a measured shape, oscillations about rest, test for reversed springs.

Functions that do not depend on time belong here.
"""

from dynamics.equilibrium.build import build_network
from dynamics.equilibrium.oscillations import Oscillations, oscillations
from dynamics.equilibrium.rest import equilibrium_with_fixed, fit_rest_lengths, reaches, rest_shape, supported
from dynamics.equilibrium.reversal import inverted_springs

__all__ = [
    "Oscillations",
    "build_network",
    "equilibrium_with_fixed",
    "fit_rest_lengths",
    "inverted_springs",
    "oscillations",
    "reaches",
    "rest_shape",
    "supported",
]
