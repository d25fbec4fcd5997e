"""Data association of interchangeable marks: exchanges of names as hypotheses, each with its filter.

What may enter: another way to decide which mark is which over time. One frame's is `vision.tracking`.
"""

from estimators.association.identity import AssociatedEstimate, AssociationFilter, IdentitySwap
from estimators.association.settings import IdentitySettings

__all__ = [
    "AssociatedEstimate",
    "AssociationFilter",
    "IdentitySettings",
    "IdentitySwap",
]
