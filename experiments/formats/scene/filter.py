"""`[uncertainty]` and `[filter]` of a scene file: uncertainty of the constants, and settings of the filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynamics import (
    KINDS,
    MassSpringNetwork,
    NetworkError,
    ParameterUncertainty,
    independent_uncertainty,
    parameter_named,
    parameters,
)
from estimators import FilterSettings, FixBias
from experiments.formats.scene.schema import FilterTable, UncertaintyTable


def uncertainty_of(table: UncertaintyTable | None, network: MassSpringNetwork) -> ParameterUncertainty | None:
    """The uncertainty of the network's constants; None without a table. Raises NetworkError for an invalid table."""
    if table is None:
        return None
    if table.parameters is None or table.directions is None:
        sds = {kind: sd for kind in KINDS if (sd := getattr(table, kind)) is not None}
        which = parameters(network, tuple(sds))
        return independent_uncertainty(which, [sds[parameter.kind] for parameter in which])
    named = []
    for i, text in enumerate(table.parameters):
        try:
            named.append(parameter_named(network, text))
        except NetworkError as error:
            raise NetworkError(f"uncertainty.parameters[{i}]: {error}") from None
    try:
        return ParameterUncertainty(tuple(named), np.array(table.directions, dtype=float).reshape(-1, len(named)))
    except NetworkError as error:
        raise NetworkError(f"uncertainty.{error}") from None


def settings_of(table: FilterTable | None) -> FilterSettings:
    """The filter's settings: the values of the table, and defaults for missing keys."""
    usual = FilterSettings()
    if table is None:
        return usual
    poke = usual.poked.poke if table.poke_m_s2 is None else table.poke_m_s2
    lasting_s = usual.poked.lasting_s if table.poke_lasting_s is None else table.poke_lasting_s
    return replace(
        usual,
        led_nodes=tuple(table.led_nodes),
        poked=replace(usual.poked, poke=poke, lasting_s=lasting_s),
        fix_bias=None if table.fix_bias_mm is None else FixBias(1e-3 * table.fix_bias_mm),
        discrepancy=table.strain,
    )


def filter_table(settings: FilterSettings) -> dict[str, float | list[str]]:
    """The keys of `[filter]` for these settings; keys with default values are omitted."""
    usual = FilterSettings()
    keys: dict[str, float | list[str]] = {}
    if settings.poked.poke != usual.poked.poke:
        keys["poke_m_s2"] = settings.poked.poke
    if settings.poked.lasting_s != usual.poked.lasting_s:
        keys["poke_lasting_s"] = settings.poked.lasting_s
    if settings.discrepancy is not None:
        keys["strain"] = settings.discrepancy
    if settings.fix_bias is not None:
        keys["fix_bias_mm"] = 1e3 * settings.fix_bias.sd_m
    if settings.led_nodes:
        keys["led_nodes"] = list(settings.led_nodes)
    return keys
