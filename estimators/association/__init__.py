"""Association of interchangeable marks, with one filter for each hypothesis about their names.

Code that decides over several frames belongs here.
"""

from estimators.association.identity import AssociatedEstimate, AssociationFilter, IdentitySwap
from estimators.association.settings import IdentitySettings

__all__ = [
    "AssociatedEstimate",
    "AssociationFilter",
    "IdentitySettings",
    "IdentitySwap",
]
