"""The filter that settings ask for."""

from __future__ import annotations

from collections.abc import Sequence

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.core.track import UnifiedFilter
from estimators.process.target import TargetPoint
from estimators.tissue.settings import FilterSettings


def filter_of(
    network: MassSpringNetwork,
    target: str | TargetPoint,
    marked: Sequence[str],
    settings: FilterSettings | None = None,
    *,
    uncertainty: ParameterUncertainty | None = None,
    n_calibration: int = 0,
) -> UnifiedFilter:
    """A filter of the tissue; raises as `UnifiedFilter` does."""
    return UnifiedFilter(network, target, marked, settings, uncertainty=uncertainty, n_calibration=n_calibration)
