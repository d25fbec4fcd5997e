"""Consistency tests: NEES, NIS, scores, whiteness, reliability, posterior Cramér-Rao bound.

Tests that change no estimate belong here.
"""

from estimators.consistency.cramer_rao import posterior_bound
from estimators.consistency.error_budget import ErrorSource, StaticResponse
from estimators.consistency.leave_one_out import LeaveOneOut, LeaveOneOutCheck
from estimators.consistency.nees import (
    anees,
    chi_square_bounds,
    coverage,
    mean_bounds,
    normalised_error_squared,
)
from estimators.consistency.reliability import ReliabilityBin, clopper_pearson, reliability_bins
from estimators.consistency.rest_bound import resting_bound
from estimators.consistency.scores import (
    crps_normal,
    energy_score,
    pit_normal,
)
from estimators.consistency.static_balance import Balance, BalanceSettings, StaticBalance
from estimators.consistency.whiteness import autocorrelation, effective_count, portmanteau

__all__ = [
    "Balance",
    "BalanceSettings",
    "ErrorSource",
    "LeaveOneOut",
    "LeaveOneOutCheck",
    "ReliabilityBin",
    "StaticBalance",
    "StaticResponse",
    "anees",
    "autocorrelation",
    "chi_square_bounds",
    "clopper_pearson",
    "coverage",
    "crps_normal",
    "effective_count",
    "energy_score",
    "mean_bounds",
    "normalised_error_squared",
    "pit_normal",
    "portmanteau",
    "posterior_bound",
    "reliability_bins",
    "resting_bound",
]
