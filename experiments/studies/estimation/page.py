"""Rewrites the tables of docs/estimation-study.md from what `experiments.studies.estimation.study` left in a folder.

python -m experiments.studies.estimation.page study
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments.formats.page import rewrite_page
from experiments.studies.estimation.study import NOISES_MM, PARTS, RATES

PAGE = Path(__file__).parents[3] / "docs" / "estimation-study.md"
Rows = Mapping[str, Mapping[str, Any]]


def table(heads: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown, the first column to the left."""
    lines = ["| " + " | ".join(heads) + " |", "| --- " + "| ---: " * (len(heads) - 1) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def usual_table(rows: Rows) -> str:
    """Errors, ratio and coverage of every row that has them."""
    heads = ["", "runs", "open loop [mm]", "filter [mm]", "ratio", "in the 95 % region", "NEES", "worst [mm]"]
    body = [
        [
            label,
            str(row["runs"]),
            f"{row['open_loop_mm']:.2f}",
            f"{row['filter_mm']:.2f}",
            f"{row['ratio']:.3f}",
            f"{row['coverage95']:.1%}",
            f"{row['nees']:.2f}",
            f"{row['worst_mm']:.1f}",
        ]
        for label, row in rows.items()
        if "ratio" in row
    ]
    return table(heads, body)


def grid_table(rows: Rows) -> str:
    """Ratios by noise and frame rate, all frames; their largest and their geometric mean below."""
    ratios = np.array([[rows[f"{noise:g} mm, {rate}/s, all"]["ratio"] for rate in RATES] for noise in NOISES_MM])
    body = [[f"{noise:g} mm", *(f"{r:.2f}" for r in line)] for noise, line in zip(NOISES_MM, ratios, strict=True)]
    summary = (
        f"Largest {ratios.max():.2f}; where the noise is 0.3 mm or more {ratios[1:].max():.2f};"
        f" geometric mean {np.exp(np.log(ratios).mean()):.2f}."
    )
    return table(["ratio", *(f"{rate}/s" for rate in RATES)], body) + "\n\n" + summary


def bound_table(rows: Rows) -> str:
    """RMSE by the bound."""
    body = [
        [label, str(row["runs"]), f"{row['rmse_mm']:.3f}", f"{row['bound_mm']:.3f}", f"{row['ratio']:.3f}"]
        for label, row in rows.items()
    ]
    return table(["", "runs", "RMSE of the filter [mm]", "bound [mm]", "ratio"], body)


def hard_table(rows: Rows) -> str:
    """Runs with large errors, and the longest time in which such an error was not reported."""
    body = [
        [
            label,
            str(row["runs"]),
            str(row["runs_diverged"]),
            str(row["runs_ever_far"]),
            f"{row['longest_unsaid_s']:.2f}",
            f"{row['worst_mm']:.1f}",
            f"{row['filter_mm']:.2f}",
            f"{row['coverage95']:.1%}",
            f"{row['diverged_frames']} of {row['frames']}",
        ]
        for label, row in rows.items()
    ]
    heads = ["", "runs", "diverged", "ever 40 mm off", "longest unreported [s]", "worst [mm]", "mean [mm]"]
    return table([*heads, "in the 95 % region", "frames DIVERGED"], body)


def lost_table(rows: Rows) -> str:
    """How many runs did what they should, and the error half a second after the marks' return."""
    body = [
        [
            label,
            str(row["runs"]),
            str(row["coasted_then_lost"]),
            str(row["grew"]),
            str(row["tracking"]),
            f"{row['coverage95']:.0%}",
            f"{row['mean_mm']:.2f}",
            f"{row['worst_mm']:.1f}",
        ]
        for label, row in rows.items()
    ]
    heads = ["", "runs", "COASTING, then LOST", "sigma grew", "TRACKING 0.5 s after", "in the 95 % region then"]
    return table([*heads, "mean [mm]", "worst [mm]"], body)


TABLES: Mapping[str, Callable[[Rows], str]] = {
    "identified": usual_table,
    "unidentified": usual_table,
    "grid": grid_table,
    "bound": bound_table,
    "hard": hard_table,
    "overturned": hard_table,
    "lost": lost_table,
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
