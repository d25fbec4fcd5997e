"""The filter of the tissue: process model, start, gate, update, health, prediction.

What may enter: what composes a generic filter with a network and its marks.
"""

from estimators.tissue.estimate import GaussianMixture, MarkMeasurement, Status, TargetEstimate
from estimators.tissue.fast_prediction import FastPredictionTables, fast_prediction_tables, predict_fast
from estimators.tissue.filter import TissueFilter
from estimators.tissue.health import Health, after_frame
from estimators.tissue.known_force import ForceHistory, KnownForce
from estimators.tissue.open_loop_cov import OpenLoopCovariance
from estimators.tissue.process_model import FixBias, ForceMode, TissueModel, accumulated_noise
from estimators.tissue.settings import FilterSettings
from estimators.tissue.snapshot import Snapshot
from estimators.tissue.target import TargetMap, TargetPoint, target_map

__all__ = [
    "FastPredictionTables",
    "FilterSettings",
    "FixBias",
    "ForceHistory",
    "ForceMode",
    "GaussianMixture",
    "Health",
    "KnownForce",
    "MarkMeasurement",
    "OpenLoopCovariance",
    "Snapshot",
    "Status",
    "TargetEstimate",
    "TargetMap",
    "TargetPoint",
    "TissueFilter",
    "TissueModel",
    "accumulated_noise",
    "after_frame",
    "fast_prediction_tables",
    "predict_fast",
    "target_map",
]
