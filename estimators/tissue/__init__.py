"""The filter of the tissue: process model, start, gate, update, health, prediction.

What may enter: what composes a generic filter with a network and its marks.
"""

from estimators.tissue.belief import Belief
from estimators.tissue.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.tissue.fast_prediction import QuickPath, quick_path, quick_tables
from estimators.tissue.filter import TissueFilter
from estimators.tissue.health import Health, after_frame
from estimators.tissue.known_force import KnownPush, Push
from estimators.tissue.open_loop_cov import OpenLoopBelief
from estimators.tissue.process_model import FixBias, ForceMode, TissueModel, grown_covariance
from estimators.tissue.settings import FilterSettings

__all__ = [
    "Belief",
    "FilterSettings",
    "FixBias",
    "ForceMode",
    "Health",
    "KnownPush",
    "MarkMeasurement",
    "OpenLoopBelief",
    "Push",
    "QuickPath",
    "Status",
    "TargetEstimate",
    "TissueFilter",
    "TissueModel",
    "after_frame",
    "grown_covariance",
    "quick_path",
    "quick_tables",
]
