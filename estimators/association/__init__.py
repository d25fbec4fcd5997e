"""Association of interchangeable marks, with one filter for each hypothesis about their names.

Code that uses several frames to assign marks to nodes belongs here.
"""

from estimators.association.identity import AssociatedEstimate, AssociationFilter, IdentitySwap
from estimators.association.settings import IdentitySettings

__all__ = [
    "AssociatedEstimate",
    "AssociationFilter",
    "IdentitySettings",
    "IdentitySwap",
]
