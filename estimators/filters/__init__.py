"""Generic filters: unscented Kalman filter, based on filterpy; estimate of a variance factor.

A filter that depends on springs or marks does not belong here.
"""

from estimators.filters.adaptation import VarianceScale
from estimators.filters.unscented import CovarianceError, UnscentedKalmanFilter, positive_points

__all__ = ["CovarianceError", "UnscentedKalmanFilter", "VarianceScale", "positive_points"]
