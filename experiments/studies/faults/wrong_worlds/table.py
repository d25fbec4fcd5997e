"""The table of the study: for each world and body, and a line for each world."""

from __future__ import annotations

import numpy as np
import pandas as pd

from experiments.studies.faults.wrong_worlds.rows import WORLDS
from experiments.studies.faults.wrong_worlds.run import REFUSED

MOST = 0.005
"""Share of the moments of GO at which the estimate may be wrong: asked for."""

SUMS = ("frames", "tracking", "tracking_wrong", "covered", "go", "go_wrong", REFUSED)

HEADS = (
    "differs from the scene",
    "GO",
    "wrong",
    "share",
    "by body",
    "TRACKING",
    "wrong",
    "median error",
    "covered 95 %",
    "shown most",
)


def rows_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each world and body, summed over seeds; error_mm: the median of them."""
    rows = []
    for (world, body), own in runs.groupby(["world", "body"], sort=False):
        sums = {key: int(own[key].sum()) for key in SUMS}
        rows.append(
            {
                "world": world,
                "body": body,
                "seeds": len(own),
                **sums,
                "go_wrong_share": _share(sums["go_wrong"], sums["go"]),
                "tracking_wrong_share": _share(sums["tracking_wrong"], sums["tracking"]),
                "covered_share": _share(sums["covered"], sums["tracking"]),
                "error_mm": float(own["error_mm"].median()),
                "shown": own["shown"].mode().iloc[0],
            }
        )
    return pd.DataFrame(rows)


def is_beyond(rows: pd.DataFrame) -> bool:
    """Whether, of any body, GO is shown on a wrong estimate in more than `MOST` of its moments."""
    return bool((rows["go_wrong_share"] > MOST).any())


def markdown(rows: pd.DataFrame) -> str:
    """A line for each world, all bodies together; one beyond the bound is marked. A world without a run is left out."""
    lines = ["| " + " | ".join(HEADS) + " |", "| --- |" + " ---: |" * (len(HEADS) - 2) + " --- |"]
    for world in WORLDS:
        own = rows[rows["world"] == world.name]
        if not own.empty:
            lines.append("| " + " | ".join(_cells(world.name, own)) + " |")
    return "\n".join(lines) + "\n"


def _cells(name: str, own: pd.DataFrame) -> list[str]:
    sums = own[list(SUMS)].sum()
    seen = own[own["go"] > 0]
    by_body = ", ".join("–" if np.isnan(share) else f"{100 * share:.1f}" for share in own["go_wrong_share"])
    share = _percent(_share(sums["go_wrong"], sums["go"]))
    refused = f"refused in {sums[REFUSED]} of {own['seeds'].sum()}: " if sums[REFUSED] else ""
    return [
        f"**{name}**" if is_beyond(seen) else name,
        str(sums["go"]),
        str(sums["go_wrong"]),
        f"**{share}**" if is_beyond(seen) else share,
        by_body,
        str(sums["tracking"]),
        _percent(_share(sums["tracking_wrong"], sums["tracking"])),
        "–" if own["error_mm"].isna().all() else f"{own['error_mm'].median():.1f} mm",
        _percent(_share(sums["covered"], sums["tracking"])),
        f"{refused}{own['shown'].mode().iloc[0]}".replace("|", "/"),
    ]


def _share(part: int, of: int) -> float:
    return part / of if of else np.nan


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.1f} %"
