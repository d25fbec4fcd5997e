"""Effective moduli of spring lattices, compared with those of the same tissue as finite elements.

    python -m experiments.studies.lattices --out DIR    # --page writes the tables to docs/lattices.md

Factors are fitted to boxes of seeds 0 to 3 and tested on other boxes. DIR gets the runs, tables.md and lattices.png.
Last figures: docs/lattices.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import pandas as pd

from dynamics.lattices import STRUCTURES
from experiments.engine.workers import chosen_workers
from experiments.errors import InputError
from experiments.formats.outputs import write_whole
from experiments.formats.page import markdown_table
from experiments.plots.style import saved
from experiments.studies.grid import add_seeds, chosen, command, grid, kept_runs, publish, seeds_of, study_options
from experiments.studies.lattices.boxes import AXES, MATERIAL, PLANES, WORDS, YOUNG, fit, tested
from experiments.studies.lattices.picture import picture

FITTED_SEEDS = range(4)
"""Seeds of the boxes to which factors are fitted; choice: other seeds than those of the reported boxes."""

CELLS = 10
"""Number of cells along a side of a box; choice: a box takes some seconds."""

FEWEST_CELLS = 6
"""Least number of cells along a side; choice: one for each of a sheet's three layers and for each gap."""


PARTS = {
    "Poisson's ratio": [f"poisson_{name}" for name in PLANES],
    "shear modulus [kPa]": [f"shear_{name}_pa" for name in PLANES],
    "bulk modulus [kPa]": ["bulk_pa"],
    "E, free sides [kPa]": [f"free_sided_{name}_pa" for name in AXES],
}
"""Columns of the properties that springs cannot reproduce."""


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over boxes, by structure and method, with the errors of Young's modulus.

    `largest_mean_error`: mean error over boxes in the worst direction; `largest_error`: largest in any box
    """
    by = ["structure", "method"]
    true = rows[rows.method == MATERIAL].set_index(["structure", "seed"])[YOUNG]
    errors = rows.set_index(["structure", "seed", "method"])[YOUNG].div(true) - 1.0
    means = rows.groupby(by, sort=False).mean(numeric_only=True)
    means["largest_mean_error"] = errors.groupby(by, sort=False).mean().abs().max(axis=1)
    means["largest_error"] = errors.abs().groupby(by, sort=False).max().max(axis=1)
    return means


def tables(means: pd.DataFrame) -> dict[str, str]:
    """The tables of a page, by name, from a `summary`."""
    kinds = list(means.index.unique("structure"))
    heads = ("structure", "tissues", "alignment", "E [kPa]", "springs")
    entries, errors, limits = [], [], []
    for kind in kinds:
        true, found = means.loc[(kind, MATERIAL)], means.loc[(kind, "fitted")]
        ground, *others = STRUCTURES[kind][1]
        tissues = f"{ground}, {100 * true.share:.0f} % {' and '.join(others)}" if true.share else ground
        alignment = f"{true.alignment:.2f}" if true.share else ""
        young = [_listed(one, YOUNG[:3]) for one in (true, found)]
        entries.append((kind, tissues, alignment, *young))
        own = [means.loc[(kind, name)] for name in WORDS]
        errors.append((kind, *(f"{100 * one.largest_mean_error:.1f}, {100 * one.largest_error:.1f}" for one in own)))
        limits.append((kind, *(_listed(one, part) for part in PARTS.values() for one in (true, found))))
    return {
        "moduli": markdown_table(heads, entries, left=(0, 1)),
        "errors": markdown_table(("structure", *(f"{word} [%]" for word in WORDS.values())), errors),
        "limits": markdown_table(("structure", *(head for part in PARTS for head in (part, "springs"))), limits),
    }


def _listed(row: pd.Series, columns: Sequence[str]) -> str:
    """Text with the values of some columns, moduli in kPa."""
    return ", ".join(
        f"{1e-3 * row[key]:#.3g}".rstrip(".") if key.endswith("_pa") else f"{row[key]:.2f}" for key in columns
    )


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Write the results."""
    parser = study_options(__doc__, page="lattices.md")
    parser.add_argument("--structures", default="", help="structures, separated by commas; default: all")
    parser.add_argument("--cells", type=int, default=CELLS, help="cells along a side; default: %(default)s")
    add_seeds(parser, 6, 1000)
    given = parser.parse_args(arguments)
    if given.cells < FEWEST_CELLS:
        raise InputError.at("--cells", f"{FEWEST_CELLS} or more", str(given.cells))
    kinds = chosen("--structures", [name for name in given.structures.split(",") if name], STRUCTURES)
    workers = chosen_workers(given)
    fits = [{"structure": kind, "cells": given.cells, "seeds": list(FITTED_SEEDS)} for kind in kinds]
    factors = kept_runs(fit, fits, given.out / "fits", workers).set_index("structure")["factors"]
    boxes = grid(structure=kinds, seed=seeds_of(given), cells=[given.cells])
    jobs = [{**case, "factors": factors[case["structure"]].tolist()} for case in boxes]
    rows = kept_runs(tested, jobs, given.out / "boxes", workers)
    means = summary(rows)
    page = tables(means)
    write_whole(given.out / "tables.md", "\n".join(page.values()))
    write_whole(given.out / "lattices.png", saved(picture(means, given.cells), "png"))
    publish(given, "\n".join(page.values()), page)


if __name__ == "__main__":
    sys.exit(main())
