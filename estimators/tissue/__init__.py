"""What a filter of the tissue takes in and gives out, its settings and its health.

What may enter: what every filter of the tissue has in common.
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
