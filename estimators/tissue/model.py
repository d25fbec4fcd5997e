"""The process model that a filter's settings ask for, by how stiff and how large the tissue is."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from dynamics import MassSpringNetwork, ParameterUncertainty, strain_uncertainty
from estimators.process.linear_motion import is_linearised
from estimators.process.process_model import TissueModel
from estimators.tissue.settings import FilterSettings


def model_of(
    network: MassSpringNetwork,
    marked: Sequence[str],
    settings: FilterSettings,
    *,
    uncertainty: ParameterUncertainty | None,
    n_calibration: int,
) -> tuple[TissueModel, FilterSettings]:
    """The model of a network with these marked nodes, and the settings for it.

    Of a stiff or large body constants without uncertainty are off by a strain, hidden nodes are poked, too, and any
    node may be led where the settings name none that are. Raises ValueError for settings that do not fit the marked
    nodes.
    """
    if settings.one_of not in (0, len(marked)):
        raise ValueError(f"settings one_of: expected 0 or {len(marked)} marked nodes, found {settings.one_of}")
    led = (settings.led_nodes, settings.leading) if settings.led_nodes else None
    model_with = partial(TissueModel, network, marked, bias=settings.fix_bias, n_calibration=n_calibration, led=led)
    model = model_with(uncertainty=uncertainty)
    if not is_linearised(model):
        return model, settings
    if uncertainty is None and settings.strain_sd > 0.0:
        uncertainty = strain_uncertainty(network, settings.strain_sd)
    return model_with(uncertainty=uncertainty, hidden_share=settings.hidden_share), settings.for_stiff_or_large()
