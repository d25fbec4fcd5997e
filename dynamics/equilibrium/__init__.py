"""Static equilibrium: rest shapes, rest lengths from a picture at rest, reversed springs.

What may enter: what does not depend on time.
"""

from dynamics.equilibrium.rest import equilibrium_with_fixed, fit_rest_lengths, reaches, rest_shape
from dynamics.equilibrium.reversal import inverted_springs

__all__ = [
    "equilibrium_with_fixed",
    "fit_rest_lengths",
    "inverted_springs",
    "reaches",
    "rest_shape",
]
