"""Interchangeable marks: exchanged names as hypotheses, each with its filter.

What may enter: decisions over several frames.
"""

from estimators.association.identity import AssociatedEstimate, AssociationFilter, IdentitySwap
from estimators.association.settings import IdentitySettings

__all__ = [
    "AssociatedEstimate",
    "AssociationFilter",
    "IdentitySettings",
    "IdentitySwap",
]
