"""Effective moduli of spring lattices, compared with those of the same tissue as finite elements.

    python -m experiments.studies.lattices --out DIR    # --page writes the tables to docs/lattices.md

Each structure has correction factors, which are fitted to its boxes of seeds 0 to 3 and tested on other boxes. If the
study succeeds, DIR gets summary.json, rows.csv, tables.md and lattices.png. Latest figures: docs/lattices.md.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from dynamics.lattices import STRUCTURES
from experiments.engine.workers import chosen_workers, workers_for
from experiments.errors import InputError
from experiments.formats.outputs import output_folder, write_whole
from experiments.plots.style import saved
from experiments.studies.grid import add_seeds, chosen, command, publish, runs_of, seeds_of, study_options
from experiments.studies.lattices.boxes import fit, tested
from experiments.studies.lattices.picture import picture
from experiments.studies.lattices.table import summary, tables

FITTED_SEEDS = range(4)
"""Seeds of the boxes to which factors are fitted; choice: other seeds than those of the reported boxes."""

CELLS = 10
"""Number of cells along a side of a box; choice: a box takes some seconds."""

FEWEST_CELLS = 6
"""Least number of cells along a side; choice: one for each of a sheet's three layers and for each gap."""


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Write the results."""
    parser = study_options(__doc__, out=False, page="lattices.md")
    parser.add_argument("--out", type=Path, required=True, help="output folder, new or empty")
    parser.add_argument("--structures", default="", help="structures, separated by commas; default: all")
    parser.add_argument("--cells", type=int, default=CELLS, help="cells along a side; default: %(default)s")
    add_seeds(parser, 6, 1000)
    given = parser.parse_args(arguments)
    if given.cells < FEWEST_CELLS:
        raise InputError.at("--cells", f"{FEWEST_CELLS} or more", str(given.cells))
    kinds = chosen("--structures", [name for name in given.structures.split(",") if name], STRUCTURES)
    with output_folder(given.out) as folder:
        fits = [(kind, FITTED_SEEDS, given.cells) for kind in kinds]
        workers = chosen_workers(given)
        factors = dict(zip(kinds, runs_of(fit, fits, workers_for(len(fits), workers)), strict=True))
        jobs = [(kind, seed, given.cells, factors[kind]) for kind in kinds for seed in seeds_of(given)]
        rows = pd.DataFrame([row for box in runs_of(tested, jobs, workers_for(len(jobs), workers)) for row in box])
        means = summary(rows)
        page = tables(means)
        methods = {kind: json.loads(means.loc[kind].to_json(orient="index")) for kind in kinds}
        content = {
            "cells": given.cells,
            "fitted_seeds": list(FITTED_SEEDS),
            "seeds": list(seeds_of(given)),
            "factors": {kind: own.tolist() for kind, own in factors.items()},
            "methods": methods,
        }
        write_whole(folder / "summary.json", json.dumps(content, indent=2) + "\n")
        write_whole(folder / "rows.csv", rows.to_csv(index=False))
        write_whole(folder / "tables.md", "\n".join(page.values()))
        write_whole(folder / "lattices.png", saved(picture(means, given.cells), "png"))
    publish(given, "\n".join(page.values()), page)


if __name__ == "__main__":
    sys.exit(main())
