"""Phantoms that come with the program.

What may enter: another network with the constants that define it.
"""

from dynamics.phantoms.four_mass import HIDDEN, OUTER, four_mass_phantom

__all__ = [
    "HIDDEN",
    "OUTER",
    "four_mass_phantom",
]
