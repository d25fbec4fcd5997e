"""Static equilibrium: rest shapes, rest lengths from a picture at rest, springs turned over.

What may enter: what holds without time.
"""

from dynamics.equilibrium.rest import equilibrium_with_held, fit_rest_lengths, rest_shape
from dynamics.equilibrium.reversal import inverted_springs

__all__ = [
    "equilibrium_with_held",
    "fit_rest_lengths",
    "inverted_springs",
    "rest_shape",
]
