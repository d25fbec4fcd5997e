"""Rewrites the tables of docs/estimation-study.md from the stored results of `experiments.studies.estimation.study`.

python -m experiments.studies.estimation.page study
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from experiments.formats.page import rewrite_page
from experiments.studies.grid import DOCS, markdown_table

PAGE = DOCS / "estimation-study.md"
Rows = Mapping[str, Mapping[str, Any]]

USUAL = {
    "filter [mm]": "{filter_mm:.2f}",
    "ratio": "{ratio:.3f}",
    "coverage": "{coverage95:.1%}",
    "NEES": "{nees:.2f}",
}
BOUND = {
    "filter RMSE [mm]": "{rmse_mm:.3f}",
    "bound [mm]": "{bound_mm:.3f}",
    "ratio": "{ratio:.3f}",
}
HARD = {
    "diverged": "{runs_diverged}/{runs}",
    "over 40 mm": "{runs_ever_far}/{runs}",
    "coverage": "{coverage95:.1%}",
}
"""Columns of the tables: heading, and format of an entry from a row."""


def table(columns: Mapping[str, str], rows: Rows, *, last: str = "") -> str:
    """A table with these columns and the rows that have runs and a label that ends with `last`."""
    shown = {label: row for label, row in rows.items() if "runs" in row and label.endswith(last)}
    return markdown_table(["", *columns], [[label, *_filled(columns, row)] for label, row in shown.items()])


def _filled(columns: Mapping[str, str], row: Mapping[str, Any]) -> list[str]:
    return [cell.format(**row) for cell in columns.values()]


TABLES: Mapping[str, Callable[[Rows], str]] = {
    "identified": partial(table, USUAL),
    "unidentified": partial(table, USUAL, last=", all"),
    "bound": partial(table, BOUND),
    "hard": partial(table, HARD),
}
"""Tables of the page, by the parts of the study that it shows."""


def main() -> None:
    """Rewrite the tables of the available parts."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    files = {name: folder / f"{name}.json" for name in TABLES if (folder / f"{name}.json").is_file()}
    rows = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in files.items()}
    rewrite_page(PAGE, {name: TABLES[name](found) for name, found in rows.items()})


if __name__ == "__main__":
    main()
