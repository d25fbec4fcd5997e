"""Methods for comparison: open loop, EKF, filterpy's UKF, EnKF, particle filter, smoother.

A new `Baseline` belongs here, with its name in `registry.py`.
"""

from estimators.baselines.baseline import Baseline
from estimators.baselines.ensemble import EnsembleKalmanFilter
from estimators.baselines.extended import ExtendedKalmanFilter
from estimators.baselines.open_loop import OpenLoop
from estimators.baselines.particles import ParticleFilter
from estimators.baselines.registry import METHODS, Method, TrackingProblem, UnknownMethodError, make_method
from estimators.baselines.smoother import FixedIntervalSmoother
from estimators.baselines.stock import StockUnscented

__all__ = [
    "METHODS",
    "Baseline",
    "EnsembleKalmanFilter",
    "ExtendedKalmanFilter",
    "FixedIntervalSmoother",
    "Method",
    "OpenLoop",
    "ParticleFilter",
    "StockUnscented",
    "TrackingProblem",
    "UnknownMethodError",
    "make_method",
]
