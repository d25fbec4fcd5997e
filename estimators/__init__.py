"""Probability: filters that tell where the target is, and how sure of it one may be."""

from estimators.adaptation import RunningScale
from estimators.advice import Advice, Guidance, Outlook, PathSource, TargetPath, advise, guide, path_times
from estimators.advice_settings import AdviceSettings, health_fault
from estimators.baseline import Baseline
from estimators.bound import posterior_bound
from estimators.breathing import Breath, Breathing, BreathingSettings
from estimators.consistency import anees, chi_square_bounds, coverage, mean_bounds, normalised_squared, over_runs
from estimators.ensemble import EnsembleKalmanFilter
from estimators.estimate import MarkMeasurement, Status, TargetEstimate
from estimators.extended import ExtendedKalmanFilter
from estimators.health import Health, after_frame
from estimators.hit_calibration import Tenth, calibration, clopper_pearson
from estimators.hit_probability import Aim, Belief, best_aim, hit_probability
from estimators.identification import IdentificationError, Identified, identify, principal
from estimators.identity import Identity, Named, Swap
from estimators.known_push import KnownPush, Push
from estimators.leave_one_out import Check, LeaveOneOut
from estimators.lesion import Lesion
from estimators.mixture import InteractingMixture, mixed
from estimators.needle import Hit, Insertion, Needle
from estimators.needle_track import Arrival, NeedleNoise, NeedleTracker
from estimators.obstacles import Obstacle, ball, clearances
from estimators.open_loop import OpenLoop
from estimators.open_loop_belief import OpenLoopBelief
from estimators.particles import ParticleFilter
from estimators.planning import Plan, PlannedNeedle, PlannedTarget, Skin, compliance, displaced, paths, plan
from estimators.quick_path import QuickPath, quick_path, quick_tables
from estimators.replay import Replay
from estimators.scores import calibration_curve, crps_normal, energy_score, pit_normal, pit_squared, uniformity
from estimators.settings import FilterSettings
from estimators.smoother import FixedLag, fixed_interval
from estimators.stock import StockUnscented
from estimators.tissue import TissueFilter
from estimators.tissue_model import FixBias, ForceMode, TissueModel, grown_covariance
from estimators.tuning import Tuned, tune
from estimators.unscented import CovarianceError, UnscentedKalmanFilter, positive_points
from estimators.whiteness import autocorrelation, portmanteau

__all__ = [
    "Advice",
    "AdviceSettings",
    "Aim",
    "Arrival",
    "Baseline",
    "Belief",
    "Breath",
    "Breathing",
    "BreathingSettings",
    "Check",
    "CovarianceError",
    "EnsembleKalmanFilter",
    "ExtendedKalmanFilter",
    "FilterSettings",
    "FixBias",
    "FixedLag",
    "ForceMode",
    "Guidance",
    "Health",
    "Hit",
    "IdentificationError",
    "Identified",
    "Identity",
    "Insertion",
    "InteractingMixture",
    "KnownPush",
    "LeaveOneOut",
    "Lesion",
    "MarkMeasurement",
    "Named",
    "Needle",
    "NeedleNoise",
    "NeedleTracker",
    "Obstacle",
    "OpenLoop",
    "OpenLoopBelief",
    "Outlook",
    "ParticleFilter",
    "PathSource",
    "Plan",
    "PlannedNeedle",
    "PlannedTarget",
    "Push",
    "QuickPath",
    "Replay",
    "RunningScale",
    "Skin",
    "Status",
    "StockUnscented",
    "Swap",
    "TargetEstimate",
    "TargetPath",
    "Tenth",
    "TissueFilter",
    "TissueModel",
    "Tuned",
    "UnscentedKalmanFilter",
    "advise",
    "after_frame",
    "anees",
    "autocorrelation",
    "ball",
    "best_aim",
    "calibration",
    "calibration_curve",
    "chi_square_bounds",
    "clearances",
    "clopper_pearson",
    "compliance",
    "coverage",
    "crps_normal",
    "displaced",
    "energy_score",
    "fixed_interval",
    "grown_covariance",
    "guide",
    "health_fault",
    "hit_probability",
    "identify",
    "mean_bounds",
    "mixed",
    "normalised_squared",
    "over_runs",
    "path_times",
    "paths",
    "pit_normal",
    "pit_squared",
    "plan",
    "portmanteau",
    "positive_points",
    "posterior_bound",
    "principal",
    "quick_path",
    "quick_tables",
    "tune",
    "uniformity",
]
