"""Table of the lungs: mean errors and coverage at the end of exhaling, and in all phases."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from estimators import coverage
from experiments.formats.page import markdown_table
from experiments.studies.lungs.estimate import SEEN, Inner

HEAD = (
    "landmarks seen",
    "no motion [mm]",
    "spline [mm]",
    "filter [mm]",
    "coverage",
    "spline, all phases [mm]",
    "filter, all phases [mm]",
    "coverage, all phases",
)


def markdown(errors: pd.DataFrame, found: Sequence[Inner]) -> str:
    """The table of `errors_table`, and below it the lungs on which the filter failed."""
    rows = []
    for seen in SEEN:
        own = errors[errors["seen"] == seen]
        last = own[own["phase"] == own["phase"].max()]
        exhaled = [_mean(last, f"{method}_mm") for method in ("nothing", "spline", "filter")]
        all_phases = [_mean(own, f"{method}_mm") for method in ("spline", "filter")]
        rows.append((seen, *exhaled, _covered(last), *all_phases, _covered(own)))
    reasons: dict[str, list[str]] = {}
    for one in found:
        if one.failure:
            reasons.setdefault(one.failure, []).append(f"{one.lung} ({one.seen})")
    failed = [f"- filter, {len(own)} of {len(found)} runs: {reason}" for reason, own in reasons.items()]
    return (markdown_table(HEAD, rows) + "\n" + "\n".join(failed)).rstrip() + "\n"


def _complete(table: pd.DataFrame, column: str) -> bool:
    return column in table and bool(table[column].notna().all())


def _mean(table: pd.DataFrame, column: str) -> str:
    """Mean of the column as text; empty if a value is missing, because the mean would then omit landmarks."""
    return f"{table[column].mean():.2f}" if _complete(table, column) else ""


def _covered(table: pd.DataFrame) -> str:
    return f"{100 * coverage(table['nees'].to_numpy(), 3):.1f}%" if _complete(table, "nees") else ""
