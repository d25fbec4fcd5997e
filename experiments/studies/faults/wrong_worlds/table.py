"""Tables of the study: one with a row for each world and body, one with a row for each world."""

from __future__ import annotations

import numpy as np
import pandas as pd

from experiments.formats.page import markdown_table
from experiments.studies.faults.wrong_worlds.rows import WORLDS
from experiments.studies.faults.wrong_worlds.run import REFUSED

MOST = 0.005
"""Largest permitted share of wrong estimates in moments with GO; a requirement."""

SUMS = ["frames", "tracking", "tracking_wrong", "covered", "go", "go_wrong", REFUSED]
SHARES = {"go_wrong": "go", "tracking_wrong": "tracking", "covered": "tracking"}
HARMLESS = (1.0, 99.0)
"""Largest median error [mm] and least coverage [%] with which a world without a wrong GO gets no row; choice: the first
is the marks' noise."""

HEADS = ["difference from the scene", "wrong GO", "median error [mm]", "coverage"]


def rows_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each world and body, with sums over seeds; error_mm: median over seeds."""
    rows = []
    for (world, body), own in runs.groupby(["world", "body"], sort=False):
        sums = own[SUMS].sum()
        shares = {f"{part}_share": _share(sums[part], sums[of]) for part, of in SHARES.items()}
        shown = own["shown"].mode().iloc[0]
        rows.append({"world": world, "body": body, "seeds": len(own), **sums, **shares})
        rows[-1] |= {"error_mm": float(own["error_mm"].median()), "shown": shown}
    return pd.DataFrame(rows)


def markdown(rows: pd.DataFrame) -> str:
    """Table with a row for each world, in bold if the share of wrong GO exceeds `MOST` with any body.

    Worlds within the bounds `HARMLESS` have no row; a line below the table names them.
    """
    lines, harmless = [], []
    for world in WORLDS:
        own = rows[rows["world"] == world]
        if own.empty:
            continue
        if _is_harmless(own):
            harmless.append("no difference" if world == "nothing" else world)
        else:
            lines.append(_cells(world, own))
    wrong, every = rows["go_wrong"].sum(), rows["go"].sum()
    bounds = f"error ≤ {HARMLESS[0]:g} mm, coverage ≥ {HARMLESS[1]:g} %, no wrong GO"
    named = f"Differences with {bounds}: {'; '.join(harmless)}.\n\n"
    return markdown_table(HEADS, lines) + f"\n{named if harmless else ''}Wrong GO: {wrong} of {every:,}.\n"


def _is_harmless(own: pd.DataFrame) -> bool:
    sums = own[SUMS].sum()
    covered = 100 * _share(sums["covered"], sums["tracking"])
    small = round(own["error_mm"].median(), 1) <= HARMLESS[0] and round(covered, 1) >= HARMLESS[1]
    return bool(small and not sums["go_wrong"] and not sums[REFUSED])


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
