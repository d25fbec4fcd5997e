"""What a filter of the tissue takes in and gives out, its settings and its health.

What may enter: what every filter of the tissue has in common.
"""

from estimators.tissue.estimate import CommonShift, GaussianMixture, MarkMeasurement, Status, TargetEstimate
from estimators.tissue.health import Health, after_frame
from estimators.tissue.settings import FilterSettings
from estimators.tissue.target_filter import PathTables, TargetFilter

__all__ = [
    "CommonShift",
    "FilterSettings",
    "GaussianMixture",
    "Health",
    "MarkMeasurement",
    "PathTables",
    "Status",
    "TargetEstimate",
    "TargetFilter",
    "after_frame",
]
