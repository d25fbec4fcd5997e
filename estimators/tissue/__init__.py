"""The filter of the tissue: start, gate, update, health, prediction.

What may enter: what composes a generic filter with a network and its marks.
"""

from estimators.tissue.estimate import CommonShift, GaussianMixture, MarkMeasurement, Status, TargetEstimate
from estimators.tissue.fast_prediction import FastPredictionTables, fast_prediction_tables, predict_fast
from estimators.tissue.filter import TissueFilter
from estimators.tissue.health import Health, after_frame
from estimators.tissue.settings import FilterSettings
from estimators.tissue.snapshot import Snapshot
from estimators.tissue.target_filter import PathTables, TargetFilter

__all__ = [
    "CommonShift",
    "FastPredictionTables",
    "FilterSettings",
    "GaussianMixture",
    "Health",
    "MarkMeasurement",
    "PathTables",
    "Snapshot",
    "Status",
    "TargetEstimate",
    "TargetFilter",
    "TissueFilter",
    "after_frame",
    "fast_prediction_tables",
    "predict_fast",
]
