"""Is the covariance to be believed: NEES, NIS, scores, whiteness, reliability, posterior Cramér-Rao bound.

What may enter: tests of estimates; none of them changes an estimate.
"""

from estimators.consistency.cramer_rao import posterior_bound
from estimators.consistency.leave_one_out import Check, LeaveOneOut
from estimators.consistency.nees import anees, chi_square_bounds, coverage, mean_bounds, normalised_squared, over_runs
from estimators.consistency.reliability import Tenth, calibration, clopper_pearson
from estimators.consistency.scores import (
    calibration_curve,
    crps_normal,
    energy_score,
    pit_normal,
    pit_squared,
    uniformity,
)
from estimators.consistency.whiteness import autocorrelation, portmanteau

__all__ = [
    "Check",
    "LeaveOneOut",
    "Tenth",
    "anees",
    "autocorrelation",
    "calibration",
    "calibration_curve",
    "chi_square_bounds",
    "clopper_pearson",
    "coverage",
    "crps_normal",
    "energy_score",
    "mean_bounds",
    "normalised_squared",
    "over_runs",
    "pit_normal",
    "pit_squared",
    "portmanteau",
    "posterior_bound",
    "uniformity",
]
