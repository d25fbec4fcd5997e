"""How often the advice GO relies on a wrong estimate, if the truth differs from the scene file.

    python -m experiments.studies.faults.wrong_worlds --out FOLDER         # all rows; --page writes the table
    python -m experiments.studies.faults.wrong_worlds --out FOLDER --only "nothing" --seeds 3

SciPy's DOP853 computes the true motion of a body under short forces and a breath. A simulated tracker measures its
marks. A live session with a scripted clock estimates the target and gives advice at every frame. In each row of the
table, the truth differs from the scene file in one property. For properties that the scene file does not state, such as
uncertainties, the filter uses defaults. The study counts displays of GO, and displays of GO with a wrong estimate. An
estimate is wrong if its error exceeds 1 mm and the truth is outside its 99.9 % region. Latest figures: docs/faults.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
import pandas as pd

from experiments.formats.outputs import write_whole
from experiments.formats.page import markdown_table
from experiments.studies.faults.wrong_worlds.rows import WORLDS
from experiments.studies.faults.wrong_worlds.run import REFUSED, run
from experiments.studies.faults.wrong_worlds.simulated import BODIES
from experiments.studies.grid import chosen, command, grid, kept_runs, publish, seeds_of, study_options

MOST = 0.005
"""Largest permitted share of the displays of GO whose estimate is wrong; a requirement."""

SUMS = ["frames", "tracking", "tracking_wrong", "covered", "go", "go_wrong", REFUSED]
SHARES = {"go_wrong": "go", "tracking_wrong": "tracking", "covered": "tracking"}
HARMLESS = (1.0, 99.0)
"""Largest median error [mm] and least coverage [%] of worlds that get no row; choice. The noise of marks is 1 mm."""

HEADS = ["difference from the scene", "wrong GO", "median error [mm]", "coverage"]


def rows_of(runs: pd.DataFrame) -> pd.DataFrame:
    """A row for each body in each of `WORLDS`. Counts are sums over seeds; error_mm: median over seeds."""
    rows = []
    for (world, body), own in runs.groupby(["world", "body"], sort=False):
        sums = own[SUMS].sum()
        shares = {f"{part}_share": _share(sums[part], sums[of]) for part, of in SHARES.items()}
        shown = own["shown"].mode().iloc[0]
        rows.append({"world": world, "body": body, "seeds": len(own), **sums, **shares})
        rows[-1] |= {"error_mm": float(own["error_mm"].median()), "shown": shown}
    return pd.DataFrame(rows)


def markdown(rows: pd.DataFrame) -> str:
    """Table with a row for each of `WORLDS`. If the share of wrong GO exceeds `MOST` for any body, the row is bold.

    Worlds without wrong GO have no row if error and coverage are within `HARMLESS`. A line below the table lists them.
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


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Do the runs that the output folder lacks, and write the tables."""
    parser = study_options(__doc__, page="faults.md", seeds=(20, 0))
    parser.add_argument("--only", action="append", default=[], help="name of a row; repeat for several; default: all")
    parser.add_argument("--bodies", action="append", default=[], help=f"one of {', '.join(BODIES)}; repeat for several")
    parser.add_argument("--seconds", type=float, help="length of a run [s]; default: 12, for the breast 8")
    given = parser.parse_args(arguments)
    worlds, bodies = chosen("--only", given.only, WORLDS), chosen("--bodies", given.bodies, BODIES)
    axes = {"duration_s": [given.seconds]} if given.seconds else {}
    # the world varies fastest, because most worlds of a body and a seed have the same truth, which is cached
    cases = grid(**axes, seed=seeds_of(given), body=bodies, world=worlds)
    rows = rows_of(kept_runs(run, cases, given.out, given).checked())
    summary = markdown(rows)
    write_whole(given.out / "wrong_worlds.csv", rows.to_csv(index=False))
    publish(given, summary, {"wrong worlds": summary}, given.out / "wrong_worlds.md")


if __name__ == "__main__":
    sys.exit(main())
