"""Generic filters on filterpy: sigma points, mixture of models, considered constants.

What may enter: probability without springs or marks.
"""

from estimators.filters.adaptation import VarianceScale
from estimators.filters.gaussians import moment_matched
from estimators.filters.mixture import InteractingMixture
from estimators.filters.unscented import CovarianceError, UnscentedKalmanFilter, positive_points

__all__ = [
    "CovarianceError",
    "InteractingMixture",
    "UnscentedKalmanFilter",
    "VarianceScale",
    "moment_matched",
    "positive_points",
]
