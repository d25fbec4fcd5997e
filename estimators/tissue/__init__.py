"""Marks, estimates, settings, and health of filters.

Data classes that all filters use belong here.
"""

from estimators.tissue.estimate import CommonShift, GaussianMixture, MarkMeasurement, Status, TargetEstimate
from estimators.tissue.health import Health, after_frame
from estimators.tissue.settings import FilterSettings

__all__ = [
    "CommonShift",
    "FilterSettings",
    "GaussianMixture",
    "Health",
    "MarkMeasurement",
    "Status",
    "TargetEstimate",
    "after_frame",
]
