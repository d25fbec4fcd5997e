"""Methods to compare with: the paper's open loop, EKF, stock filterpy UKF, EnKF, particle filter.

What may enter: another method, as a `Baseline` in a file of its own.
"""

from estimators.baselines.baseline import Baseline
from estimators.baselines.ensemble import EnsembleKalmanFilter
from estimators.baselines.extended import ExtendedKalmanFilter
from estimators.baselines.open_loop import OpenLoop
from estimators.baselines.particles import ParticleFilter
from estimators.baselines.stock import StockUnscented

__all__ = [
    "Baseline",
    "EnsembleKalmanFilter",
    "ExtendedKalmanFilter",
    "OpenLoop",
    "ParticleFilter",
    "StockUnscented",
]
