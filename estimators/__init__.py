"""Probability: filters that tell where the target is, and how sure of it one may be."""

from estimators.adaptation import RunningScale
from estimators.ball_probability import ball_probability
from estimators.baseline import Baseline
from estimators.bound import posterior_bound
from estimators.consistency import anees, chi_square_bounds, coverage, mean_bounds, normalised_squared, over_runs
from estimators.ensemble import EnsembleKalmanFilter
from estimators.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.extended import ExtendedKalmanFilter
from estimators.health import Health
from estimators.identification import IdentificationError, Identified, identify, principal
from estimators.known_push import KnownPush, Push
from estimators.leave_one_out import Check, LeaveOneOut
from estimators.mixture import InteractingMixture, mixed
from estimators.needle_track import Arrival, NeedleNoise, NeedleTracker
from estimators.obstacles import Obstacle, ball, clearances
from estimators.open_loop import OpenLoop
from estimators.open_loop_belief import OpenLoopBelief
from estimators.particles import ParticleFilter
from estimators.planning import Lesion, Plan, PlannedNeedle, Skin, compliance, displaced, paths, plan
from estimators.replay import Replay
from estimators.scores import (
    calibration_curve,
    crps_normal,
    energy_score,
    pit_normal,
    pit_squared,
    uniformity,
)
from estimators.settings import FilterSettings
from estimators.smoother import FixedLag, fixed_interval
from estimators.stock import StockUnscented
from estimators.tissue import TissueFilter
from estimators.tissue_model import FixBias, ForceMode, TissueModel, grown_covariance
from estimators.tuning import Tuned, tune
from estimators.unscented import CovarianceError, UnscentedKalmanFilter, positive_points
from estimators.whiteness import autocorrelation, portmanteau

__all__ = [
    "Arrival",
    "Baseline",
    "Check",
    "CovarianceError",
    "EnsembleKalmanFilter",
    "ExtendedKalmanFilter",
    "FilterSettings",
    "FixBias",
    "FixedLag",
    "ForceMode",
    "Health",
    "IdentificationError",
    "Identified",
    "InteractingMixture",
    "KnownPush",
    "LeaveOneOut",
    "Lesion",
    "MarkMeasurement",
    "NeedleNoise",
    "NeedleTracker",
    "Obstacle",
    "OpenLoop",
    "OpenLoopBelief",
    "ParticleFilter",
    "Plan",
    "PlannedNeedle",
    "Push",
    "Replay",
    "RunningScale",
    "Skin",
    "Status",
    "StockUnscented",
    "TargetEstimate",
    "TissueFilter",
    "TissueModel",
    "Tuned",
    "UnscentedKalmanFilter",
    "anees",
    "autocorrelation",
    "ball",
    "ball_probability",
    "calibration_curve",
    "chi_square_bounds",
    "clearances",
    "compliance",
    "coverage",
    "crps_normal",
    "displaced",
    "energy_score",
    "fixed_interval",
    "grown_covariance",
    "identify",
    "mean_bounds",
    "mixed",
    "normalised_squared",
    "over_runs",
    "paths",
    "pit_normal",
    "pit_squared",
    "plan",
    "portmanteau",
    "positive_points",
    "posterior_bound",
    "principal",
    "tune",
    "uniformity",
]
