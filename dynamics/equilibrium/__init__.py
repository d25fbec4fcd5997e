"""Static equilibrium: rest shapes, rest lengths from a picture at rest, reversed springs.

What may enter: what does not depend on time.
"""

from dynamics.equilibrium.mirrored import hidden_parts, mirrored_shapes
from dynamics.equilibrium.rest import equilibrium_with_fixed, fit_rest_lengths, reaches, rest_shape
from dynamics.equilibrium.reversal import inverted_springs

__all__ = [
    "equilibrium_with_fixed",
    "fit_rest_lengths",
    "hidden_parts",
    "inverted_springs",
    "mirrored_shapes",
    "reaches",
    "rest_shape",
]
