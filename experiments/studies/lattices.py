"""Effective moduli of tissue as a spring lattice, compared with moduli of the same tissue as finite elements.

    python -m experiments.studies.lattices --out DIR    # --page writes the tables to docs/lattices.md

The correction factors of a structure are fitted to boxes with the seeds 0 to 3, and tested on other boxes. DIR gets
summary.json, rows.csv, tables.md and lattices.png. Latest figures: docs/lattices.md.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from scipy.sparse import csc_array

from dynamics.lattices import (
    DIRECTIONS,
    STRUCTURES,
    Lattice,
    Sample,
    directed,
    effective_stiffness,
    fitted_factors,
    free_sided_young,
    lattice_network,
    lattice_of,
    lloyd,
    orthotropic_moduli,
    spring_stiffness,
    van_gelder,
    young_along,
)
from dynamics.mesh import Tissue
from dynamics.mesh.tissues import TISSUES
from experiments.arrays import Floats
from experiments.errors import InputError
from experiments.formats.outputs import output_folder, write_whole
from experiments.formats.page import markdown_table
from experiments.plots.style import (
    BLACK,
    GREY,
    OURS,
    PAGE_MM,
    PAPERS,
    PURPLE,
    VERMILLION,
    legend_below,
    new_figure,
    saved,
    styled,
)
from experiments.studies.grid import chosen, command, publish, runs_of, seeds_of, study_options

SIDE_M = 0.024
"""Side length of a box [m]; the moduli do not depend on it."""

MATERIAL = "material"
METHODS = ("van_gelder", "lloyd", "fitted", "own")
"""Methods for the stiffness of springs: the published formulas of Van Gelder and of Lloyd, factors fitted to other
boxes of the structure, and factors fitted to the box itself."""

AXES, PLANES = ("x", "y", "z"), ("yz", "xz", "xy")

Row = dict[str, Any]


def lattice_by_seed(kind: str, seed: int, cells: int) -> tuple[Lattice, list[Tissue]]:
    """A random lattice of a structure, and the structure's tissues."""
    make, names = STRUCTURES[kind]
    rng = np.random.default_rng(seed)
    return lattice_of(make(rng), SIDE_M, cells, rng), [TISSUES[name] for name in names]


def fit(job: tuple[str, Sequence[int], int]) -> Floats:
    """The fitted correction factors of a structure, (6,); job: structure, seeds of boxes, number of cells per side."""
    kind, seeds, cells = job
    samples = []
    for seed in seeds:
        lattice, tissues = lattice_by_seed(kind, seed, cells)
        wanted = effective_stiffness(lattice.element_stiffness(tissues), lattice.mesh.nodes)
        samples.append(_sample(lattice, tissues, young_along(wanted, DIRECTIONS)))
    return fitted_factors(samples)


def tested(job: tuple[str, int, int, Floats]) -> list[Row]:
    """Results for one box: a row for the finite elements, and a row for the springs of each method.

    job: structure, seed, number of cells per side, correction factors of the structure
    alignment: mean of `Lattice.alignment` over the structure's springs
    crossing: share of springs that cross a surface of the structure
    share: share of the box's volume that the structure's tissues fill
    """
    kind, seed, cells, factors = job
    lattice, tissues = lattice_by_seed(kind, seed, cells)
    elements, inside = lattice.element_stiffness(tissues), lattice.mesh.regions > 0
    wanted = young_along(effective_stiffness(elements, lattice.mesh.nodes), DIRECTIONS)
    sample = _sample(lattice, tissues, wanted)
    stiffness = {
        "van_gelder": sample.stiffness,
        "lloyd": lloyd(lattice, lattice.of_elements(tissues, "young_pa")),
        "fitted": directed(lattice, sample.stiffness, factors),
        "own": directed(lattice, sample.stiffness, fitted_factors([sample])),
    }
    box = {
        "structure": kind,
        "seed": seed,
        "alignment": float(lattice.alignment[np.unique(lattice.edges[inside])].mean()) if inside.any() else np.nan,
        "crossing": float(lattice.crossing.mean()),
        "share": float(lattice.mesh.volumes[inside].sum() / lattice.mesh.volumes.sum()),
    }
    bodies = {name: spring_stiffness(lattice_network(lattice, stiffness[name], tissues)) for name in METHODS}
    return [box | {"method": name} | _moduli(K, lattice) for name, K in ({MATERIAL: elements} | bodies).items()]


def _sample(lattice: Lattice, tissues: Sequence[Tissue], young: Floats) -> Sample:
    return Sample(lattice, van_gelder(lattice, lattice.of_elements(tissues, "young_pa")), young)


def _moduli(K: csc_array, lattice: Lattice) -> Row:
    found = orthotropic_moduli(effective_stiffness(K, lattice.mesh.nodes))
    along, free = young_along(found.stiffness, DIRECTIONS), free_sided_young(K, lattice.mesh.nodes)
    named = {f"young_{name}_pa": value for name, value in zip(AXES + PLANES, along, strict=True)}
    named |= {f"free_sided_{name}_pa": value for name, value in zip(AXES, free, strict=True)}
    for key, values in (("shear_{}_pa", found.shear), ("poisson_{}", found.poisson)):
        named |= {key.format(name): value for name, value in zip(PLANES, values, strict=True)}
    return {key: float(value) for key, value in named.items()} | {"bulk_pa": found.bulk, "anisotropy": found.anisotropy}


WORDS = {"van_gelder": "Van Gelder", "lloyd": "Lloyd", "fitted": "fitted to other boxes"}
"""Column headings of the methods in the table of errors. The method `own` has no column, as its errors are zero."""

YOUNG = [f"young_{name}_pa" for name in AXES + PLANES]
"""Columns of Young's moduli along axes and diagonals."""

PARTS = {
    "Poisson's ratio": [f"poisson_{name}" for name in PLANES],
    "shear modulus [kPa]": [f"shear_{name}_pa" for name in PLANES],
    "bulk modulus [kPa]": ["bulk_pa"],
}
"""Properties that springs cannot reproduce, with their columns in the results."""


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over boxes for each structure and method, with two errors of Young's modulus.

    `largest_mean_error`: for each direction, the mean error over boxes; of these means, the largest magnitude
    `largest_error`: largest magnitude of the error in any box and any direction
    """
    by = ["structure", "method"]
    true = rows[rows.method == MATERIAL].set_index(["structure", "seed"])[YOUNG]
    errors = rows.set_index(["structure", "seed", "method"])[YOUNG].div(true) - 1.0
    means = rows.drop(columns="seed").groupby(by, sort=False).mean()
    means["largest_mean_error"] = errors.groupby(by, sort=False).mean().abs().max(axis=1)
    means["largest_error"] = errors.abs().groupby(by, sort=False).max().max(axis=1)
    return means


def tables(means: pd.DataFrame) -> dict[str, str]:
    """The tables of docs/lattices.md, by name; means: result of `summary`."""
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
    """The values in these columns as text; moduli are in kPa."""
    return ", ".join(
        f"{1e-3 * row[key]:#.3g}".rstrip(".") if key.endswith("_pa") else f"{row[key]:.2f}" for key in columns
    )


SHOWN_SEED = 1000
"""Seed of the drawn lattices."""

COLORS = ("0.75", OURS, VERMILLION)
"""Colours of the springs in the surrounding tissue, and in the tissues of the structure."""

PLACES = {"lobules": 0.35, "fibres": 0.375}
"""By structure, the coordinate y of the drawn plane divided by the side of the box; 0.5 for all other structures."""

STYLES: dict[str, dict[str, Any]] = {
    "van_gelder": {"color": PAPERS, "marker": "s"},
    "lloyd": {"color": PURPLE, "marker": "D"},
    "fitted": {"color": OURS, "marker": "o"},
}


@styled
def picture(means: pd.DataFrame, cells: int) -> Figure:
    """Two plots for each structure: springs in a plane perpendicular to y, and moduli."""
    figure = new_figure(PAGE_MM, 95.0)
    kinds = list(means.index.unique("structure"))
    axes = figure.subplots(2, len(kinds), squeeze=False, height_ratios=[1.0, 1.1])
    for (slice_, moduli), kind in zip(axes.T, kinds, strict=True):
        _draw_slice(slice_, kind, cells)
        slice_.set_title(kind)
        _draw_moduli(moduli, 1e-3 * means.loc[kind][YOUNG])
    axes[0, 0].set(ylabel="z [mm]")
    axes[1, 0].set(ylabel="Young's modulus [kPa]")
    legend_below(figure, axes[1, 0], 1 + len(STYLES))
    return figure


def _draw_slice(ax: Axes, kind: str, cells: int) -> None:
    """Draw the springs near a plane perpendicular to y; springs inside the structure have wider lines."""
    lattice, tissues = lattice_by_seed(kind, SHOWN_SEED, cells)
    ends = 1e3 * lattice.mesh.nodes[lattice.springs]
    near = (np.abs(ends[:, :, 1] - 1e3 * PLACES.get(kind, 0.5) * SIDE_M) < 600.0 * SIDE_M / cells).all(axis=1)
    region = np.zeros(len(lattice.springs), dtype=int)
    for k in range(1, len(tissues)):
        region[lattice.edges[lattice.mesh.regions == k]] = k
    for k, color in enumerate(COLORS[: len(tissues)]):
        own = near & (region == k)
        ax.add_collection(LineCollection(list(ends[own][:, :, [0, 2]]), colors=color, lw=0.4 if k == 0 else 0.8))
    limits, ticks = (-0.5, 1e3 * SIDE_M + 0.5), (0, 12, 24)
    ax.set(xlim=limits, ylim=limits, aspect="equal", xlabel="x [mm]", xticks=ticks, yticks=ticks)


def _draw_moduli(ax: Axes, young_kpa: pd.DataFrame) -> None:
    places = np.arange(len(YOUNG))
    ax.hlines(young_kpa.loc[MATERIAL], places - 0.4, places + 0.4, color=BLACK, lw=1.2, label="material")
    for k, (name, style) in enumerate(STYLES.items()):
        ax.plot(places + 0.2 * (k - 1), young_kpa.loc[name], ls="none", ms=2.5, label=WORDS[name], **style)
    highest = young_kpa.loc[[MATERIAL, *STYLES]].to_numpy().max()
    ax.set(xticks=places, xticklabels=AXES + PLANES, ylim=(0.0, 1.08 * highest), xlabel="along")
    ax.grid(axis="y", lw=0.3, color=GREY)


FITTED_SEEDS = range(4)
"""Seeds of the boxes to which the correction factors are fitted. The reported boxes have other seeds; choice."""

CELLS = 10
"""Number of cells along a side of a box; choice: a box takes some seconds."""

FEWEST_CELLS = 6
"""Least number of cells along a side; choice: a `sheet` has three layers and three gaps, each at least one cell."""


@command
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study, and write its results."""
    parser = study_options(__doc__, out=False, page="lattices.md", seeds=(6, 1000))
    parser.add_argument("--out", type=Path, required=True, help="output folder, new or empty")
    parser.add_argument("--structures", default="", help="structures, separated by commas; default: all")
    parser.add_argument("--cells", type=int, default=CELLS, help="cells along a side; default: %(default)s")
    given = parser.parse_args(arguments)
    if given.cells < FEWEST_CELLS:
        raise InputError.at("--cells", f"{FEWEST_CELLS} or more", str(given.cells))
    kinds = chosen("--structures", [name for name in given.structures.split(",") if name], STRUCTURES)
    with output_folder(given.out) as folder:
        fits = [(kind, FITTED_SEEDS, given.cells) for kind in kinds]
        factors = dict(zip(kinds, runs_of(fit, fits, given), strict=True))
        jobs = [(kind, seed, given.cells, factors[kind]) for kind in kinds for seed in seeds_of(given)]
        rows = pd.DataFrame([row for box in runs_of(tested, jobs, given) for row in box])
        means = summary(rows)
        page = tables(means)
        content = {
            "cells": given.cells,
            "fitted_seeds": list(FITTED_SEEDS),
            "seeds": list(seeds_of(given)),
            "factors": {kind: own.tolist() for kind, own in factors.items()},
            "methods": {kind: json.loads(means.loc[kind].to_json(orient="index")) for kind in kinds},
        }
        write_whole(folder / "summary.json", json.dumps(content, indent=2) + "\n")
        write_whole(folder / "rows.csv", rows.to_csv(index=False))
        write_whole(folder / "tables.md", "\n".join(page.values()))
        write_whole(folder / "lattices.png", saved(picture(means, given.cells), "png"))
    publish(given, "\n".join(page.values()), page)


if __name__ == "__main__":
    sys.exit(main())
