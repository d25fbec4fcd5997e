"""The table of the study: for each world and body, and a line for each world."""

from __future__ import annotations

import numpy as np
import pandas as pd

from experiments.studies.faults.wrong_worlds.rows import WORLDS
from experiments.studies.faults.wrong_worlds.run import REFUSED
from experiments.studies.grid import markdown_table

MOST = 0.005
"""Share of the moments of GO at which the estimate may be wrong: asked for."""

SUMS = ["frames", "tracking", "tracking_wrong", "covered", "go", "go_wrong", REFUSED]
SHARES = {"go_wrong": "go", "tracking_wrong": "tracking", "covered": "tracking"}
HEADS = ["difference from the scene", "wrong GO", "median error [mm]", "coverage"]


def rows_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each world and body, summed over seeds; error_mm: the median of them."""
    rows = []
    for (world, body), own in runs.groupby(["world", "body"], sort=False):
        sums = own[SUMS].sum()
        shares = {f"{part}_share": _share(sums[part], sums[of]) for part, of in SHARES.items()}
        shown = own["shown"].mode().iloc[0]
        rows.append({"world": world, "body": body, "seeds": len(own), **sums, **shares})
        rows[-1] |= {"error_mm": float(own["error_mm"].median()), "shown": shown}
    return pd.DataFrame(rows)


def markdown(rows: pd.DataFrame) -> str:
    """A line for each world, all bodies together; one beyond the bound is marked. A world without a run is left out."""
    known = set(rows["world"])
    lines = [_cells(world, rows[rows["world"] == world]) for world in WORLDS if world in known]
    return markdown_table(HEADS, lines)


def _cells(name: str, own: pd.DataFrame) -> list[str]:
    sums = own[SUMS].sum()
    mark = "**" if (own["go_wrong_share"] > MOST).any() else ""
    refused = f", refused {sums[REFUSED]}/{own['seeds'].sum()}" if sums[REFUSED] else ""
    return [
        f"{mark}{name}{mark}",
        f"{mark}{sums['go_wrong']}/{sums['go']}{mark}{refused}",
        "–" if own["error_mm"].isna().all() else f"{own['error_mm'].median():.1f}",
        _percent(_share(sums["covered"], sums["tracking"])),
    ]


def _share(part: int, of: int) -> float:
    return part / of if of else np.nan


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.1f}%"
