"""Phantoms that come with the program.

What may enter: another network with its published or chosen constants.
"""

from dynamics.phantoms.four_mass import HIDDEN, OUTER, four_mass_phantom

__all__ = [
    "HIDDEN",
    "OUTER",
    "four_mass_phantom",
]
