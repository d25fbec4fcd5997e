"""Static equilibrium: rest shapes, rest lengths from a picture, networks that rest as drawn, reversed springs.

What may enter: what does not depend on time.
"""

from dynamics.equilibrium.build import build_network
from dynamics.equilibrium.mirrored import elbow_parts, mirror_through, mirrored_shapes
from dynamics.equilibrium.rest import carried, equilibrium_with_fixed, fit_rest_lengths, reaches, rest_shape
from dynamics.equilibrium.reversal import inverted_springs

__all__ = [
    "build_network",
    "carried",
    "elbow_parts",
    "equilibrium_with_fixed",
    "fit_rest_lengths",
    "inverted_springs",
    "mirror_through",
    "mirrored_shapes",
    "reaches",
    "rest_shape",
]
