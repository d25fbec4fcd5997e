"""Generic filters built on filterpy: sigma points, estimates of a variance factor.

What may enter: no springs, no marks.
"""

from estimators.filters.adaptation import VarianceScale
from estimators.filters.unscented import CovarianceError, UnscentedKalmanFilter, positive_points

__all__ = [
    "CovarianceError",
    "UnscentedKalmanFilter",
    "VarianceScale",
    "positive_points",
]
