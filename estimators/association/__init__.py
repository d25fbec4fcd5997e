"""Association of interchangeable marks: a filter for each hypothesis about names.

Decisions over several frames belong here.
"""

from estimators.association.identity import AssociatedEstimate, AssociationFilter, IdentitySwap
from estimators.association.settings import IdentitySettings

__all__ = [
    "AssociatedEstimate",
    "AssociationFilter",
    "IdentitySettings",
    "IdentitySwap",
]
