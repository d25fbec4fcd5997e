"""Estimation of a tissue's constants and of its model's error from recordings.

Quantities that are estimated once, not in each frame, belong here.
"""

from estimators.identification.budget import Budget, IdentificationError, Workers
from estimators.identification.constants import (
    IdentificationResult,
    IdentificationSettings,
    identify_constants,
    principal_uncertainty,
)
from estimators.identification.determined import MAX_VARIANCE_LEFT
from estimators.identification.groups import ConstantGroup, constant_groups, group_label, group_value
from estimators.identification.residuals import ResidualTest
from estimators.identification.strain import TuningResult, tune_strain

__all__ = [
    "MAX_VARIANCE_LEFT",
    "Budget",
    "ConstantGroup",
    "IdentificationError",
    "IdentificationResult",
    "IdentificationSettings",
    "ResidualTest",
    "TuningResult",
    "Workers",
    "constant_groups",
    "group_label",
    "group_value",
    "identify_constants",
    "principal_uncertainty",
    "tune_strain",
]
