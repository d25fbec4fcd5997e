"""The filter that settings ask for."""

from __future__ import annotations

from collections.abc import Sequence

from dynamics import MassSpringNetwork, ParameterUncertainty
from estimators.core.track import UnifiedFilter
from estimators.process.target import TargetPoint
from estimators.tissue.filter import TissueFilter
from estimators.tissue.settings import FilterSettings


def filter_of(
    network: MassSpringNetwork,
    target: str | TargetPoint,
    marked: Sequence[str],
    settings: FilterSettings | None = None,
    *,
    uncertainty: ParameterUncertainty | None = None,
    n_calibration: int = 0,
) -> TissueFilter | UnifiedFilter:
    """A filter of the tissue: `UnifiedFilter` where the settings say so, else `TissueFilter`; raises as they do."""
    made = UnifiedFilter if settings is not None and settings.unified else TissueFilter
    return made(network, target, marked, settings, uncertainty=uncertainty, n_calibration=n_calibration)
