"""Generic filters on filterpy: sigma points, mixture of models, considered constants.

What may enter: probability that knows neither springs nor marks.
"""

from estimators.filters.adaptation import RunningScale
from estimators.filters.mixture import InteractingMixture, mixed
from estimators.filters.unscented import CovarianceError, UnscentedKalmanFilter, positive_points

__all__ = [
    "CovarianceError",
    "InteractingMixture",
    "RunningScale",
    "UnscentedKalmanFilter",
    "mixed",
    "positive_points",
]
