"""Probability: filters that tell where the target is, and how sure of it one may be."""

from estimators.consistency import chi_square_bounds, coverage, mean_bounds, normalised_squared
from estimators.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.mixture import InteractingMixture, mixed
from estimators.open_loop import OpenLoop
from estimators.settings import FilterSettings
from estimators.tissue import TissueFilter
from estimators.tissue_model import FixBias, ForceMode, TissueModel, grown_covariance
from estimators.unscented import CovarianceError, UnscentedKalmanFilter, positive_points

__all__ = [
    "CovarianceError",
    "FilterSettings",
    "FixBias",
    "ForceMode",
    "InteractingMixture",
    "MarkMeasurement",
    "OpenLoop",
    "Status",
    "TargetEstimate",
    "TissueFilter",
    "TissueModel",
    "UnscentedKalmanFilter",
    "chi_square_bounds",
    "coverage",
    "grown_covariance",
    "mean_bounds",
    "mixed",
    "normalised_squared",
    "positive_points",
]
