"""Static equilibrium: rest shapes, rest lengths from a picture at rest, springs turned over.

What may enter: what holds without time.
"""

from dynamics.equilibrium.rest import at_rest_where_seen, rest_shape, shape_held
from dynamics.equilibrium.reversal import reversed_springs

__all__ = [
    "at_rest_where_seen",
    "rest_shape",
    "reversed_springs",
    "shape_held",
]
