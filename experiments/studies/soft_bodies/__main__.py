"""Filter for a continuum, tested on soft bodies whose meshes, laws and integrators differ from the filter's.

    python -m experiments.studies.soft_bodies --out DIR    # --page writes the table to docs/meshes.md

True blocks have MuJoCo's elements; true breasts have neo-Hookean elements. Marks on the skin are accurate to 0.5 mm,
the target is hidden, and the stiffness is known to a factor of two. The filter's constants were chosen with seeds 0
to 3. DIR gets the runs, summary.json and table.md; an interrupted study continues there.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

import pandas as pd

from experiments.engine.workers import chosen_workers
from experiments.formats.outputs import write_whole
from experiments.formats.page import markdown_table
from experiments.studies.grid import add_seeds, command, grid, kept_runs, publish, seeds_of, study_options
from experiments.studies.soft_bodies.bodies import BODIES
from experiments.studies.soft_bodies.run import run

FIGURES = {
    "skin_mm": "skin moves by [mm]",
    "moved_mm": "target moves by [mm]",
    "filter_mm": "filter [mm]",
    "open_loop_mm": "open loop [mm]",
    "thin_plate_mm": "thin-plate spline [mm]",
    "covered": "filter covered",
}
"""Headings of the table's columns. The table has means over recordings."""


def summary(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """A row for each body, with means over its recordings."""
    bodies = rows.groupby("body", sort=False)
    means = bodies[[*FIGURES, "ms"]].mean()
    means.insert(0, "n", bodies.size())
    return means.reset_index().to_dict("records")


def markdown(found: Sequence[dict[str, Any]]) -> str:
    """The table of docs/meshes.md."""
    rows = []
    for one in found:
        figures = [f"{100 * one[key]:.0f} %" if key == "covered" else f"{one[key]:.2f}" for key in FIGURES]
        rows.append((one["body"], *figures))
    return markdown_table(("body", *FIGURES.values()), rows)


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Write the results of the study."""
    parser = study_options(__doc__, page="meshes.md")
    add_seeds(parser, 6, 20)
    parser.add_argument("--bodies", action="append", choices=list(BODIES), help="name of a body; repeat for several")
    given = parser.parse_args(arguments)
    cases = grid(body=given.bodies or BODIES, seed=seeds_of(given))
    found = summary(kept_runs(run, cases, given.out, chosen_workers(given)))
    page = markdown(found)
    write_whole(given.out / "summary.json", json.dumps({"rows": found}, indent=2) + "\n")
    write_whole(given.out / "table.md", page)
    publish(given, page, {"soft bodies table": page})


if __name__ == "__main__":
    sys.exit(main())
