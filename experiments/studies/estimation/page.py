"""Rewrites the tables of docs/estimation-study.md from what `experiments.studies.estimation.study` left in a folder.

python -m experiments.studies.estimation.page study
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.formats.page import rewrite_page
from experiments.studies.estimation.study import NOISES_MM, PARTS, RATES
from experiments.studies.grid import DOCS, markdown_table

PAGE = DOCS / "estimation-study.md"
Rows = Mapping[str, Mapping[str, Any]]

USUAL = {
    "runs": "{runs}",
    "open loop [mm]": "{open_loop_mm:.2f}",
    "filter [mm]": "{filter_mm:.2f}",
    "ratio": "{ratio:.3f}",
    "in the 95 % region": "{coverage95:.1%}",
    "NEES": "{nees:.2f}",
    "worst [mm]": "{worst_mm:.1f}",
}
BOUND = {
    "runs": "{runs}",
    "RMSE of the filter [mm]": "{rmse_mm:.3f}",
    "bound [mm]": "{bound_mm:.3f}",
    "ratio": "{ratio:.3f}",
}
HARD = {
    "runs": "{runs}",
    "diverged": "{runs_diverged}",
    "ever 40 mm off": "{runs_ever_far}",
    "longest unreported [s]": "{longest_unsaid_s:.2f}",
    "worst [mm]": "{worst_mm:.1f}",
    "mean [mm]": "{filter_mm:.2f}",
    "in the 95 % region": "{coverage95:.1%}",
    "frames DIVERGED": "{diverged_frames} of {frames}",
}
LOST = {
    "runs": "{runs}",
    "COASTING, then LOST": "{coasted_then_lost}",
    "sigma grew": "{grew}",
    "TRACKING 0.5 s after": "{tracking}",
    "in the 95 % region then": "{coverage95:.0%}",
    "mean [mm]": "{mean_mm:.2f}",
    "worst [mm]": "{worst_mm:.1f}",
}
"""Columns of the tables: head, and how it is filled from a row."""


def table(columns: Mapping[str, str], rows: Rows) -> str:
    """The rows that have runs, with these columns."""
    body = [[label, *(cell.format(**row) for cell in columns.values())] for label, row in rows.items() if "runs" in row]
    return markdown_table(["", *columns], body)


def grid_table(rows: Rows) -> str:
    """Ratios by noise and frame rate, all frames; their largest and their geometric mean below."""
    ratios = np.array([[rows[f"{noise:g} mm, {rate}/s, all"]["ratio"] for rate in RATES] for noise in NOISES_MM])
    body = [[f"{noise:g} mm", *(f"{r:.2f}" for r in line)] for noise, line in zip(NOISES_MM, ratios, strict=True)]
    return (
        markdown_table(["ratio", *(f"{rate}/s" for rate in RATES)], body)
        + f"\nLargest {ratios.max():.2f}; where the noise is 0.3 mm or more {ratios[1:].max():.2f};"
        f" geometric mean {np.exp(np.log(ratios).mean()):.2f}."
    )


TABLES: Mapping[str, Callable[[Rows], str]] = {
    "identified": partial(table, USUAL),
    "unidentified": partial(table, USUAL),
    "grid": grid_table,
    "bound": partial(table, BOUND),
    "hard": partial(table, HARD),
    "overturned": partial(table, HARD),
    "lost": partial(table, LOST),
}


def main() -> None:
    """Rewrite the tables of the parts that are there."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    files = {name: folder / f"{name}.json" for name in PARTS if (folder / f"{name}.json").is_file()}
    rows = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in files.items()}
    rewrite_page(PAGE, {name: TABLES[name](found) for name, found in rows.items()})


if __name__ == "__main__":
    main()
